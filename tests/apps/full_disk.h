// SPDX-License-Identifier: Apache-2.0
//
// A disk that is full for a while, as far as files of this process and its children can tell.
#pragma once

#include <signal.h>
#include <sys/resource.h>

namespace covey {

// Files cannot grow beyond so many bytes: what is written across the limit stays torn, as on a full
// disk. Without a limit again at the end of its life.
class FullDisk {
 public:
  explicit FullDisk(rlim_t file_bytes) : handler_(signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = file_bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  sighandler_t handler_;
  rlimit before_{};
};

}  // namespace covey
