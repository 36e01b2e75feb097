// SPDX-License-Identifier: Apache-2.0
//
// A drone whose camera has a rolling shutter, rendered, whole pipeline; minutes without
// optimisation.
#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

#include "apps/dataset.h"
#include "apps/path_figures.h"
#include "apps/pipeline.h"
#include "sim/simulation.h"

namespace covey {
namespace {

// Around the castle, 14 ms from the first row to the last; the drone takes `believed_s` for it.
PathFigures fly(double line_delay_s, double believed_s) {
  SimulationRequest request;
  request.scenario = Scenario::kCastleAround;
  request.seed = 5;
  request.agents = 1;
  request.duration_s = 4;
  request.camera_rate_hz = 15;
  request.line_delay_s = line_delay_s;
  request.texture_size = 2048;
  std::vector<DroneSimulation> drones = make_simulation(request);
  DroneSimulation& drone = drones.front();
  const GroundTruth truth{drone.true_states()};
  AgentConfig config;
  config.agent.mode = FlightMode::kSolo;
  SensorSetup sensors{drone.camera().intrinsics, drone.plan().flight.extrinsics,
                      drone.plan().imu_noise};
  sensors.line_delay_s = believed_s;
  Pipeline pipeline(config, sensors, truth);
  FlownPath path;
  std::size_t next_imu = 0;
  for (const TimeNs stamp_ns : drone.image_stamps()) {
    add_imu_for(stamp_ns, drone.plan().imu.samples, next_imu, pipeline);
    const ImageResult result = pipeline.add_image(stamp_ns, drone.next_image().grey);
    const auto there = ground_truth_at(truth, stamp_ns);
    if (!result.odometry || !there) continue;
    path.odometry.push_back(*result.odometry);
    path.truth.push_back(there->pose);
  }
  return figures_of(path);
}

TEST(RollingShutter, FliesAlmostAsOneThatLooksAtOnce) {
  constexpr double kLineDelay_s = 3e-5;
  const PathFigures at_once = fly(0, 0);
  const PathFigures rolling = fly(kLineDelay_s, kLineDelay_s);
  const PathFigures not_told = fly(kLineDelay_s, 0);
  EXPECT_LT(rolling.unaligned_m, 2 * at_once.unaligned_m + 0.01);
  EXPECT_LT(rolling.position_nees, 8) << "of 3 degrees of freedom, one flight";
  EXPECT_GT(not_told.unaligned_m, 3 * rolling.unaligned_m) << "else this shows nothing";
}

}  // namespace
}  // namespace covey
