// SPDX-License-Identifier: Apache-2.0
//
// Says what a camera's and an IMU's drivers would say, for a drone that listens with an
// OnboardLink.
#pragma once

#include <chrono>
#include <memory>

#include "comms/onboard_link.h"

namespace covey {

class SensorPlayer {
 public:
  // Takes domain, network and the sensors' topics. Throws as OnboardLink does.
  explicit SensorPlayer(const OnboardConfig& config);
  ~SensorPlayer();
  SensorPlayer(const SensorPlayer&) = delete;
  SensorPlayer& operator=(const SensorPlayer&) = delete;

  // False: a reader that asks for every sample has not taken the old ones within five seconds.
  bool play(const CameraImage& image);
  bool play(const ImuSample& sample);

  [[nodiscard]] bool is_heard() const;  // both topics are, by somebody
  // True once all who ask for every sample have all of them.
  [[nodiscard]] bool wait_until_received(std::chrono::milliseconds patience);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
