// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "apps/file_descriptor.h"

namespace covey {

// A team's folder of results while its drones start. What an earlier run has left in it is set
// aside, and comes back unless the drones fly; what else is there is left alone.
class RunFolder {
 public:
  // Throws std::runtime_error when it is no folder, not empty and may not be replaced, or another
  // one has it.
  RunFolder(std::filesystem::path run, bool replace);
  ~RunFolder();  // as it was before, if it was not kept
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;

  // The drones fly: the earlier run is taken away.
  void keep();

 private:
  void put_back() const;

  std::filesystem::path run_;
  FileDescriptor lock_;
  bool kept_ = false;
};

}  // namespace covey
