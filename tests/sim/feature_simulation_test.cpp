// SPDX-License-Identifier: Apache-2.0
#include "sim/feature_simulation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <unordered_map>

namespace covey {
namespace {

FeatureScenario scenario_of(Scenario scenario, double duration_s) {
  FeatureScenario result;
  result.flight.scenario = scenario;
  result.flight.duration_s = duration_s;
  return result;
}

// Error of an observation against the true geometry, px.
double error_px(const FeatureSimulation& simulation, const DroneFeatures& drone, std::size_t image,
                std::size_t track, double focal_px) {
  const TrackObservation& seen = drone.camera[image].tracks[track];
  const Pose& pose = drone.truth[image].state.pose;
  const Eigen::Vector3d p_imu =
      pose.q_world_imu.conjugate() *
      (simulation.landmarks_world[drone.landmark_of_track.at(seen.track_id)] - pose.p_world_imu);
  const Eigen::Vector3d p_cam =
      drone.extrinsics.q_imu_cam.conjugate() * (p_imu - drone.extrinsics.p_imu_cam);
  return focal_px * (seen.bearing - p_cam.head<2>() / p_cam.z()).norm();
}

TEST(FeatureSimulation, ObservationsObeyTheTrueGeometryInEveryScenario) {
  for (const Scenario place :
       {Scenario::kCastleAround, Scenario::kCastleParallel, Scenario::kMarsYard, Scenario::kRoom}) {
    SCOPED_TRACE(scenario_name(place));
    FeatureScenario scenario = scenario_of(place, 6);
    const FeatureSimulation simulation = simulate_features(scenario, 2);
    double sum2 = 0;
    std::size_t count = 0;
    for (const DroneFeatures& drone : simulation.drones) {
      for (std::size_t k = 0; k < drone.camera.size(); ++k) {
        for (std::size_t i = 0; i < drone.camera[k].tracks.size(); ++i, ++count) {
          const double error = error_px(simulation, drone, k, i, 455);
          ASSERT_LT(error, 6 * scenario.camera.pixel_sigma);
          sum2 += error * error;
        }
      }
    }
    ASSERT_GT(count, 10000u);
    EXPECT_NEAR(std::sqrt(sum2 / (2 * static_cast<double>(count))), 0.7, 0.02);
  }
}

TEST(FeatureSimulation, SigmaIsThatOfTheNoise) {
  FeatureScenario scenario = scenario_of(Scenario::kRoom, 2);
  scenario.camera.pixel_sigma = 0.91;
  const FeatureSimulation simulation = simulate_features(scenario, 1);
  EXPECT_NEAR(std::sqrt(simulation.drones[0].camera[3].tracks[0].covariance(0, 0)), 0.91 / 455,
              1e-12);
}

TEST(FeatureSimulation, TracksAreAsManyAndAsLongAsRealOnes) {
  for (const Scenario place :
       {Scenario::kCastleAround, Scenario::kCastleParallel, Scenario::kMarsYard, Scenario::kRoom}) {
    SCOPED_TRACE(scenario_name(place));
    const FeatureScenario scenario = scenario_of(place, 0);
    const FeatureSimulation simulation = simulate_features(scenario, 3);
    for (const DroneFeatures& drone : simulation.drones) {
      SCOPED_TRACE(drone.name);
      std::size_t observations = 0;
      for (const CameraMeasurement& image : drone.camera) {
        EXPECT_LE(image.tracks.size(), 120u);
        EXPECT_GE(image.tracks.size(), 25u);
        observations += image.tracks.size();
      }
      const double images = static_cast<double>(drone.camera.size());
      EXPECT_GT(static_cast<double>(observations) / images, 60) << "tracks in an image";
      const double length =
          static_cast<double>(observations) / static_cast<double>(drone.landmark_of_track.size());
      EXPECT_GT(length, 10) << "images for each track";
      EXPECT_LT(length, 32) << "images for each track";
    }
  }
}

TEST(FeatureSimulation, ATrackIsNeverSeenAgainAfterItEnded) {
  const FeatureSimulation simulation = simulate_features(scenario_of(Scenario::kRoom, 20), 5);
  for (const DroneFeatures& drone : simulation.drones) {
    std::unordered_map<std::uint64_t, std::size_t> last_image;
    std::set<std::size_t> landmarks;
    bool came_back = false;
    for (std::size_t k = 0; k < drone.camera.size(); ++k) {
      for (const TrackObservation& track : drone.camera[k].tracks) {
        const auto known = last_image.find(track.track_id);
        if (known != last_image.end()) {
          ASSERT_EQ(known->second + 1, k) << "track " << track.track_id;
        } else if (!landmarks.insert(drone.landmark_of_track.at(track.track_id)).second) {
          came_back = true;
        }
        last_image[track.track_id] = k;
      }
    }
    EXPECT_TRUE(came_back) << "landmarks seen again must come as new tracks";
  }
}

TEST(FeatureSimulation, OutlierShareIsRight) {
  FeatureScenario scenario = scenario_of(Scenario::kMarsYard, 15);
  scenario.camera.outlier_share = 0.08;
  const FeatureSimulation simulation = simulate_features(scenario, 4);
  double outliers = 0, count = 0;
  for (const DroneFeatures& drone : simulation.drones) {
    for (std::size_t k = 0; k < drone.camera.size(); ++k) {
      for (std::size_t i = 0; i < drone.camera[k].tracks.size(); ++i) {
        const bool outlier = drone.truth[k].outlier[i] != 0;
        EXPECT_EQ(outlier, error_px(simulation, drone, k, i, 455) > 4.9);
        outliers += outlier ? 1 : 0;
        ++count;
      }
    }
  }
  EXPECT_NEAR(outliers / count, 0.08, 0.01);
}

TEST(FeatureSimulation, IsTheSameForOneSeedAndDiffersForAnother) {
  const FeatureScenario scenario = scenario_of(Scenario::kCastleParallel, 4);
  const FeatureSimulation a = simulate_features(scenario, 7), b = simulate_features(scenario, 7);
  const FeatureSimulation c = simulate_features(scenario, 8);
  ASSERT_EQ(a.drones.size(), b.drones.size());
  for (std::size_t d = 0; d < a.drones.size(); ++d) {
    ASSERT_EQ(a.drones[d].camera.size(), b.drones[d].camera.size());
    for (std::size_t k = 0; k < a.drones[d].camera.size(); ++k) {
      const auto &left = a.drones[d].camera[k].tracks, &right = b.drones[d].camera[k].tracks;
      ASSERT_EQ(left.size(), right.size());
      for (std::size_t i = 0; i < left.size(); ++i) {
        EXPECT_EQ(left[i].track_id, right[i].track_id);
        EXPECT_EQ(left[i].bearing, right[i].bearing);
      }
    }
    EXPECT_EQ(a.drones[d].imu.back().gyro_imu, b.drones[d].imu.back().gyro_imu);
    EXPECT_NE(a.drones[d].imu.back().gyro_imu, c.drones[d].imu.back().gyro_imu);
  }
}

TEST(FeatureSimulation, DronesSeeTheSameLandmarks) {
  const FeatureSimulation simulation =
      simulate_features(scenario_of(Scenario::kCastleParallel, 9), 1);
  std::unordered_map<std::size_t, std::set<std::string>> seen_by;
  for (const DroneFeatures& drone : simulation.drones) {
    for (const auto& [track, landmark] : drone.landmark_of_track) {
      seen_by[landmark].insert(drone.name);
    }
  }
  std::size_t shared = 0;
  for (const auto& [landmark, names] : seen_by) shared += names.size() == 3 ? 1 : 0;
  EXPECT_GT(shared, 200u);
}

TEST(FeatureSimulation, StampsLackTheTimeOffsetAndKeepThePhase) {
  FeatureScenario scenario = scenario_of(Scenario::kRoom, 3);
  scenario.camera.rate_hz = 20;
  scenario.camera.first_image_s = 0.0017;
  scenario.camera.time_offset_s = -0.008;
  const FeatureSimulation simulation = simulate_features(scenario, 1);
  const DroneFeatures& drone = simulation.drones[0];
  EXPECT_EQ(drone.extrinsics.time_offset_s, -0.008);
  EXPECT_EQ(drone.imu.front().stamp_ns, scenario.start_ns);
  for (std::size_t k = 0; k < drone.camera.size(); ++k) {
    const TimeNs exposed_ns = scenario.start_ns + 1'700'000 + static_cast<TimeNs>(k) * 50'000'000;
    EXPECT_EQ(drone.camera[k].stamp_ns, exposed_ns + 8'000'000);
    const Pose exposed = drone.trajectory.pose_at(0.0017 + 0.05 * static_cast<double>(k));
    EXPECT_LT((drone.truth[k].state.pose.p_world_imu - exposed.p_world_imu).norm(), 1e-9);
    EXPECT_LT(exposed_ns, drone.imu.back().stamp_ns);
  }
}

}  // namespace
}  // namespace covey
