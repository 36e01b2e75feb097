// SPDX-License-Identifier: Apache-2.0
//
// A DDS domain that no other team on this machine uses.
#pragma once

namespace covey {

// Held as long as this lives: a lock file in the folder for temporary files, which the system lets
// go of whatever happens to the program.
class FreeDomain {
 public:
  FreeDomain();  // throws std::runtime_error when all are taken or the folder allows no file
  ~FreeDomain();
  FreeDomain(const FreeDomain&) = delete;
  FreeDomain& operator=(const FreeDomain&) = delete;

  [[nodiscard]] int id() const { return id_; }

 private:
  int id_ = -1;
  int lock_fd_ = -1;
};

}  // namespace covey
