// SPDX-License-Identifier: Apache-2.0
//
// A filter's state in flight, built by hand from a simulated drone: a full window of keyframes and
// the tracks that were seen in it.
#pragma once

#include <map>
#include <vector>

#include "estimator/imu_buffer.h"
#include "estimator/imu_increment.h"
#include "estimator/observation_model.h"
#include "estimator/state.h"
#include "estimator/track_store.h"
#include "estimator/vision_update.h"
#include "sim/feature_simulation.h"

namespace covey {

struct FilledWindow {
  EstimatorConfig config;
  FeatureSimulation simulation;
  State state;
  std::vector<Track> tracks;  // seen in every clone
  ImuInterval last_interval;  // the IMU between the last two clones
};

inline FeatureScenario window_scenario() {
  FeatureScenario scenario;
  scenario.flight.scenario = Scenario::kCastleParallel;
  scenario.flight.agents = 1;
  scenario.camera.rate_hz = 10;
  scenario.camera.max_tracks = 400;
  scenario.camera.loss_share = 0;
  scenario.camera.pixel_sigma = 0.3;
  return scenario;
}

inline State state_at(const EstimatorConfig& config, const ImageTruth& truth, TimeNs stamp_ns) {
  const ImuState imu{stamp_ns, truth.state.pose, truth.state.v_world_imu, truth.bias.gyro,
                     truth.bias.accel};
  // It has drifted: the position is the least certain.
  Eigen::Matrix<double, 15, 15> P = Eigen::Matrix<double, 15, 15>::Identity() * 1e-6;
  P.topLeftCorner<3, 3>() = 0.1 * 0.1 * Eigen::Matrix3d::Identity();
  return State(config, imu, P);
}

// `first_image`: of the window, in motion.
inline FilledWindow filled_window(std::uint64_t seed, std::size_t first_image = 30) {
  EstimatorConfig config;
  FeatureSimulation simulation = simulate_features(window_scenario(), seed);
  const DroneFeatures& drone = simulation.drones.front();
  config.extrinsics = drone.extrinsics;
  config.imu_noise = adis16448().noise;
  FilledWindow window{
      config,
      {},
      state_at(config, drone.truth[first_image], drone.camera[first_image].stamp_ns),
      {},
      {}};
  ImuBuffer imu;
  for (const ImuSample& sample : drone.imu) {
    (void)imu.add(sample, config.max_gyro, config.max_accel);
  }
  std::map<std::uint64_t, Track> tracks;
  const std::size_t clones = static_cast<std::size_t>(config.max_clones) + 1;
  for (std::size_t k = 0; k < clones; ++k) {
    const CameraMeasurement& image = drone.camera[first_image + k];
    State& state = window.state;
    if (k > 0) {
      const ImuState& now = state.imu();
      window.last_interval = imu.between(now.stamp_ns, image.stamp_ns);
      state.propagate(
          integrate_imu(window.last_interval, now.gyro_bias, now.accel_bias, config.imu_noise),
          image.stamp_ns, config.gravity, config.imu_noise);
    }
    state.add_clone(k + 1, image.stamp_ns, true, Eigen::Vector3d::Zero());
    for (const TrackObservation& seen : image.tracks) {
      Track& track = tracks[seen.track_id];
      track.id = seen.track_id;
      track.seen_now = k + 1 == clones;
      track.observations.push_back({k + 1, seen.bearing, whitening(seen.covariance)});
    }
  }
  for (const auto& [id, track] : tracks) {
    if (track.observations.size() == clones) window.tracks.push_back(track);
  }
  window.simulation = std::move(simulation);
  return window;
}

inline std::vector<const Track*> some_tracks(const FilledWindow& window, std::size_t begin,
                                             std::size_t count) {
  std::vector<const Track*> chosen;
  for (std::size_t i = begin; i < window.tracks.size() && chosen.size() < count; ++i) {
    chosen.push_back(&window.tracks[i]);
  }
  return chosen;
}

// Makes the first `count` tracks SLAM features.
inline void add_slam_features(FilledWindow& window, int count) {
  VisionUpdate vision(window.config, window.state.capacity());
  UpdateReport report;
  (void)vision.update_tracks(
      window.state, {}, some_tracks(window, 0, static_cast<std::size_t>(2 * count)), count, report);
}

// Takes so much from the variance of one part of the state that no covariance is left.
inline void make_impossible(State& state, int row) {
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(state.dimension());
  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(state.dimension(), state.dimension());
  state.correct(none, unit.col(row), Eigen::MatrixXd::Constant(1, 1, 1e-2));
}

}  // namespace covey
