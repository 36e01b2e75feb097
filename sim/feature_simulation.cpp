// SPDX-License-Identifier: Apache-2.0
#include "sim/feature_simulation.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "sim/landmark_world.h"
#include "sim/random.h"

namespace covey {
namespace {

constexpr std::uint64_t kNoTrack = 0;

struct Sighting {
  std::size_t landmark = 0;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
};

class View {
 public:
  View(const FeatureCamera& camera, const Pose& pose, const CameraExtrinsics& extrinsics)
      : camera_(camera),
        R_cam_world_((pose.q_world_imu * extrinsics.q_imu_cam).toRotationMatrix().transpose()),
        p_world_cam_(pose.p_world_imu + pose.q_world_imu * extrinsics.p_imu_cam) {}

  [[nodiscard]] std::optional<Eigen::Vector2d> bearing_of(const SurfaceLandmark& landmark) const {
    const Eigen::Vector3d ray_world = landmark.p_world - p_world_cam_;
    const double depth = R_cam_world_.row(2).dot(ray_world);
    if (depth < camera_.min_depth || depth > camera_.max_depth) return std::nullopt;
    if (landmark.normal_world.dot(ray_world) > 0) return std::nullopt;
    const Eigen::Vector2d bearing = R_cam_world_.topRows<2>() * ray_world / depth;
    if (std::abs(bearing.x()) * camera_.focal_px > camera_.width_px / 2) return std::nullopt;
    if (std::abs(bearing.y()) * camera_.focal_px > camera_.height_px / 2) return std::nullopt;
    return bearing;
  }

 private:
  const FeatureCamera& camera_;
  Eigen::Matrix3d R_cam_world_;
  Eigen::Vector3d p_world_cam_;
};

// Keeps track ids over the images of one drone: a landmark that is lost comes back as a new track.
class FeatureTracks {
 public:
  FeatureTracks(const FeatureCamera& camera, const std::vector<SurfaceLandmark>& landmarks,
                std::uint64_t seed, std::uint64_t stream)
      : camera_(camera),
        landmarks_(landmarks),
        random_(seed, stream),
        track_of_(landmarks.size(), kNoTrack) {}

  // Fills the measurement's tracks, the truth's outliers and the landmarks of new tracks.
  void observe(const View& view, CameraMeasurement& measurement, ImageTruth& truth,
               std::unordered_map<std::uint64_t, std::size_t>& landmark_of_track) {
    const std::vector<Sighting> sightings = keep_and_refill(view, landmark_of_track);
    measurement.tracks.reserve(sightings.size());
    for (const Sighting& sighting : sightings) {
      const bool outlier = random_.unit() < camera_.outlier_share;
      const Eigen::Vector2d error_px = outlier ? outlier_error() : noise_error();
      TrackObservation observation;
      observation.track_id = track_of_[sighting.landmark];
      observation.bearing = sighting.bearing + error_px / camera_.focal_px;
      observation.covariance =
          std::pow(camera_.pixel_sigma / camera_.focal_px, 2) * Eigen::Matrix2d::Identity();
      measurement.tracks.push_back(observation);
      truth.outlier.push_back(outlier ? 1 : 0);
    }
  }

 private:
  std::vector<Sighting> keep_and_refill(
      const View& view, std::unordered_map<std::uint64_t, std::size_t>& landmark_of_track) {
    std::vector<Sighting> kept, candidates;
    for (std::size_t i = 0; i < landmarks_.size(); ++i) {
      const std::optional<Eigen::Vector2d> bearing = view.bearing_of(landmarks_[i]);
      const bool tracked = track_of_[i] != kNoTrack;
      const bool lost = !bearing || (tracked && random_.unit() < camera_.loss_share);
      if (lost) {
        track_of_[i] = kNoTrack;
      } else {
        (tracked ? kept : candidates).push_back({i, *bearing});
      }
    }
    const auto wanted = static_cast<std::size_t>(std::max(0, camera_.max_tracks));
    while (kept.size() < wanted && !candidates.empty()) {
      std::swap(candidates[random_.index(candidates.size())], candidates.back());
      kept.push_back(candidates.back());
      candidates.pop_back();
      track_of_[kept.back().landmark] = ++last_track_;
      landmark_of_track[last_track_] = kept.back().landmark;
    }
    return kept;
  }

  Eigen::Vector2d noise_error() {
    const double x = random_.gaussian(), y = random_.gaussian();
    return camera_.pixel_sigma * Eigen::Vector2d(x, y);
  }

  Eigen::Vector2d outlier_error() {
    constexpr double kLeast_px = 5;
    const double size = random_.uniform(kLeast_px, std::max(kLeast_px, camera_.outlier_px));
    const double direction = random_.uniform(0, 2 * M_PI);
    return size * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  }

  const FeatureCamera& camera_;
  const std::vector<SurfaceLandmark>& landmarks_;
  Random random_;
  std::vector<std::uint64_t> track_of_;
  std::uint64_t last_track_ = kNoTrack;
};

DroneFeatures simulate_drone(const DronePlan& plan, const FeatureScenario& scenario,
                             const std::vector<SurfaceLandmark>& landmarks, std::uint64_t seed,
                             std::uint64_t index) {
  const FeatureCamera& camera = scenario.camera;
  DroneFeatures drone{plan.name, plan.trajectory, plan.extrinsics, {}, {}, {}, {}};
  drone.extrinsics.time_offset_s = camera.time_offset_s;
  const std::uint64_t drone_seed = seed * 1000 + index;
  ImuRecording imu = simulate_imu(plan.trajectory, scenario.imu, drone_seed, scenario.start_ns);

  FeatureTracks tracks(camera, landmarks, drone_seed, 0x7eac);
  // The last image leaves room for an IMU sample after it.
  const double last_s = plan.trajectory.duration_s() - 1 / scenario.imu.rate_hz;
  for (int k = 0;; ++k) {
    const double exposed_s = camera.first_image_s + k / camera.rate_hz;
    if (exposed_s > last_s) break;
    const TimeNs exposed_ns = scenario.start_ns + nanoseconds(exposed_s);
    CameraMeasurement measurement;
    measurement.stamp_ns = exposed_ns - nanoseconds(camera.time_offset_s);
    ImageTruth truth{plan.trajectory.at(exposed_s), imu.bias_at(exposed_ns), {}};
    const View view(camera, truth.state.pose, plan.extrinsics);
    tracks.observe(view, measurement, truth, drone.landmark_of_track);
    drone.camera.push_back(std::move(measurement));
    drone.truth.push_back(std::move(truth));
  }
  drone.imu = std::move(imu.samples);
  return drone;
}

}  // namespace

FeatureSimulation simulate_features(const FeatureScenario& scenario, std::uint64_t seed) {
  if (!(scenario.camera.rate_hz > 0) || !(scenario.imu.rate_hz > 0)) {
    throw std::runtime_error("feature simulation: camera and IMU rates must be positive");
  }
  FlightRequest flight = scenario.flight;
  flight.seed = seed;
  const std::vector<DronePlan> plans = plan_flights(flight);
  const Scenario place = flight.recorded.empty() ? flight.scenario : Scenario::kRoom;
  const auto landmarks = landmark_world(place, plans, scenario.landmarks, seed);

  FeatureSimulation simulation;
  for (const SurfaceLandmark& landmark : landmarks) {
    simulation.landmarks_world.push_back(landmark.p_world);
  }
  for (const DronePlan& plan : plans) {
    simulation.drones.push_back(
        simulate_drone(plan, scenario, landmarks, seed, simulation.drones.size()));
  }
  return simulation;
}

}  // namespace covey
