// SPDX-License-Identifier: Apache-2.0
//
// How a drone is, for who looks at it from outside: a container's health check, a person. Nobody on
// board needs it: that it cannot be written, because the disk is full, is warned of once.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>

namespace covey {

class StatusFile {
 public:
  // Writes that nothing has been flown yet: to meet others takes a while.
  explicit StatusFile(std::filesystem::path file);

  // A second after it was written last, by a clock that goes on whatever is flown.
  [[nodiscard]] bool due(double now_ms) const;  // of steady_ms()
  void write(const nlohmann::json& status, double now_ms);

 private:
  std::filesystem::path file_;
  double written_ms_ = 0;
  bool warned_ = false;
};

}  // namespace covey
