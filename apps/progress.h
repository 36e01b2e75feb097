// SPDX-License-Identifier: Apache-2.0
//
// How far work on many images or flights has come, on stderr: a bar on a terminal, a line now and
// then in a log file.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>

namespace covey {

// Told after each image of a flight.
using OnImage = std::function<void(std::size_t done, std::size_t images)>;

class Progress {
 public:
  // `what`: they are.
  explicit Progress(std::size_t total, const char* what = "images");
  void show(std::size_t done);

 private:
  std::size_t total_;
  const char* what_;
  bool terminal_;
  std::chrono::steady_clock::time_point start_;
  double next_s_ = 0;
};

}  // namespace covey
