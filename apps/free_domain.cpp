// SPDX-License-Identifier: Apache-2.0
#include "apps/free_domain.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace covey {
namespace {

// Whoever has made it: to lock it takes no more than to read it. A folder for everybody's temporary
// files may refuse O_CREAT for a file of somebody else.
int open_lock(const char* file) {
  const int fd = open(file, O_RDONLY | O_CLOEXEC);
  if (fd >= 0 || errno != ENOENT) return fd;
  const int made = open(file, O_CREAT | O_RDONLY | O_CLOEXEC, 0644);
  if (made >= 0) fchmod(made, 0644);  // whatever the umask
  return made;
}

}  // namespace

FreeDomain::FreeDomain() {
  // Domain 0 is everybody's default; ports of domains above 100 overlap the ephemeral ones; those
  // above 60 are for links that are made in one process (tests/comms/team_config.h).
  constexpr int kFirst = 1, kLast = 60;
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  const int start = getpid() % (kLast - kFirst + 1);
  std::string not_opened;  // why, if any was not
  for (int i = 0; i <= kLast - kFirst; ++i) {
    const int id = kFirst + (start + i) % (kLast - kFirst + 1);
    const auto file = folder / ("covey-domain-" + std::to_string(id) + ".lock");
    const int fd = open_lock(file.c_str());
    if (fd < 0) {
      not_opened = file.string() + " cannot be opened: " + std::strerror(errno);
      continue;
    }
    if (flock(fd, LOCK_EX | LOCK_NB) == 0) {
      id_ = id;
      lock_fd_ = fd;
      return;
    }
    close(fd);
  }
  if (!not_opened.empty()) {
    throw std::runtime_error("no free DDS domain: " + not_opened +
                             "; set TMPDIR to a folder that can be written to");
  }
  throw std::runtime_error("no free DDS domain: all of " + std::to_string(kFirst) + ".." +
                           std::to_string(kLast) + " are locked in " + folder.string() +
                           "/covey-domain-*.lock");
}

FreeDomain::~FreeDomain() {
  if (lock_fd_ >= 0) close(lock_fd_);
}

}  // namespace covey
