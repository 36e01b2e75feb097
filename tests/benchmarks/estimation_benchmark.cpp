// SPDX-License-Identifier: Apache-2.0
//
// What the filter's stages cost: 11 keyframes and the present image, 40 SLAM features, one core.

#include <benchmark/benchmark.h>

#include <vector>

#include "estimator/slam_update.h"
#include "estimator/vision_update.h"
#include "tests/estimator/filled_window.h"

namespace covey {
namespace {

constexpr int kSlamFeatures = 40;
constexpr std::size_t kMsckfFeatures = 12;  // a busy image's, each seen in the whole window

const FilledWindow& window() {
  static const FilledWindow filled = [] {
    FilledWindow window = filled_window(1);
    add_slam_features(window, kSlamFeatures);
    return window;
  }();
  return filled;
}

// An image's interval of 1/30 s of a 200 Hz IMU, and the covariance carried over it.
void BM_Propagation(benchmark::State& timing) {
  State state = window().state;
  const std::vector<ImuSample>& samples = window().last_interval.samples;
  const ImuInterval interval{{samples.begin(), samples.begin() + 8}};
  for (auto _ : timing) {
    const ImuState& now = state.imu();
    const ImuIncrement increment =
        integrate_imu(interval, now.gyro_bias, now.accel_bias, window().config.imu_noise);
    state.propagate(increment, now.stamp_ns, window().config.gravity, window().config.imu_noise);
  }
  timing.counters["dimension"] = state.dimension();
}
BENCHMARK(BM_Propagation)->Unit(benchmark::kMicrosecond);

// What the other benchmarks pay before they start.
void BM_CopyOfTheState(benchmark::State& timing) {
  for (auto _ : timing) benchmark::DoNotOptimize(State(window().state));
}
BENCHMARK(BM_CopyOfTheState)->Unit(benchmark::kMicrosecond);

void BM_MsckfUpdate(benchmark::State& timing) {
  VisionUpdate vision(window().config, window().state.capacity());
  const auto features = some_tracks(window(), 2 * kSlamFeatures, kMsckfFeatures);
  UpdateReport report;
  for (auto _ : timing) {
    State state = window().state;
    report = {};
    benchmark::DoNotOptimize(vision.update_tracks(state, features, {}, 0, report));
  }
  timing.counters["used"] = report.msckf_used;
}
BENCHMARK(BM_MsckfUpdate)->Unit(benchmark::kMicrosecond);

void BM_SlamUpdate(benchmark::State& timing) {
  SlamUpdate slam(window().config, window().state.capacity());
  std::vector<TrackObservation> observations;
  for (const Track& track : window().tracks) {
    const CloneObservation& now = track.observations.back();
    observations.push_back(
        {track.id, now.bearing, (now.whitening.transpose() * now.whitening).inverse()});
  }
  UpdateReport report;
  for (auto _ : timing) {
    State state = window().state;
    report = {};
    slam.update(state, observations, report);
  }
  timing.counters["used"] = report.slam_used;
}
BENCHMARK(BM_SlamUpdate)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace covey
