// SPDX-License-Identifier: Apache-2.0
//
// What an image costs from the camera's pixels to the odometry, by stage: a drone's first 12
// seconds, alone, images rendered beforehand. Each counter is CPU ms per image.
#include <benchmark/benchmark.h>

#include <opencv2/core.hpp>
#include <vector>

#include "apps/pipeline.h"
#include "sim/simulation.h"

namespace covey {
namespace {

struct Rendered {
  DroneSimulation drone;
  std::vector<cv::Mat> images;
};

Rendered rendered(Scenario scenario, bool raw16) {
  SimulationRequest request;
  request.scenario = scenario;
  request.seed = 8;
  request.agents = 1;
  request.duration_s = 12;
  Rendered flight{make_simulation(request).front(), {}};
  for (std::size_t i = 0; i < flight.drone.image_stamps().size(); ++i) {
    SimulatedImage image = flight.drone.next_image();
    flight.images.push_back(raw16 ? image.raw16 : image.grey);
  }
  return flight;
}

void count(const TimingRecord& timing, benchmark::State& state) {
  state.counters["thermal"] += timing.thermal_ms;
  state.counters["track"] += timing.track_ms;
  state.counters["propagate"] += timing.propagate_ms;
  state.counters["msckf"] += timing.msckf_ms;
  state.counters["slam"] += timing.slam_ms;
}

void whole_image(benchmark::State& state, Scenario scenario, bool raw16) {
  const Rendered flight = rendered(scenario, raw16);
  const DroneSimulation& drone = flight.drone;
  AgentConfig config;
  config.agent.mode = FlightMode::kSolo;
  SensorSetup sensors{drone.camera().intrinsics, drone.plan().flight.extrinsics,
                      drone.plan().imu_noise};
  sensors.thermal = drone.plan().thermal;
  double images = 0;
  for (auto _ : state) {
    Pipeline pipeline(config, sensors, GroundTruth{drone.true_states()});
    std::size_t next_imu = 0;
    for (std::size_t i = 0; i < flight.images.size(); ++i, ++images) {
      const TimeNs stamp_ns = drone.image_stamps()[i];
      add_imu_for(stamp_ns, drone.plan().imu.samples, next_imu, pipeline);
      count(pipeline.add_image(stamp_ns, flight.images[i]).timing, state);
    }
  }
  for (auto& [name, counter] : state.counters) counter.value /= images;
  state.counters["image"] =
      benchmark::Counter(images / 1000, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

BENCHMARK_CAPTURE(whole_image, thermal8, Scenario::kMarsYard, false)->Unit(benchmark::kSecond);
BENCHMARK_CAPTURE(whole_image, thermal16, Scenario::kMarsYard, true)->Unit(benchmark::kSecond);
BENCHMARK_CAPTURE(whole_image, visual, Scenario::kCastleParallel, false)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace covey
