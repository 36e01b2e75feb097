// SPDX-License-Identifier: Apache-2.0
#include "apps/free_domain.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <filesystem>
#include <stdexcept>
#include <string>

namespace covey {

FreeDomain::FreeDomain() {
  // Domain 0 is everybody's default; ports of domains above 100 overlap the ephemeral ones; those
  // above 60 are for links that are made in one process (tests/comms/team_config.h).
  constexpr int kFirst = 1, kLast = 60;
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  const int start = getpid() % (kLast - kFirst + 1);
  for (int i = 0; i <= kLast - kFirst; ++i) {
    const int id = kFirst + (start + i) % (kLast - kFirst + 1);
    const auto file = folder / ("covey-domain-" + std::to_string(id) + ".lock");
    const int fd = open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666);
    if (fd < 0) continue;
    if (flock(fd, LOCK_EX | LOCK_NB) == 0) {
      id_ = id;
      lock_fd_ = fd;
      return;
    }
    close(fd);
  }
  throw std::runtime_error("no free DDS domain: all of " + std::to_string(kFirst) + ".." +
                           std::to_string(kLast) + " are locked in " + folder.string() +
                           "/covey-domain-*.lock");
}

FreeDomain::~FreeDomain() {
  if (lock_fd_ >= 0) close(lock_fd_);
}

}  // namespace covey
