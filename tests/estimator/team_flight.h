// SPDX-License-Identifier: Apache-2.0
//
// A team of estimators in the feature-level simulation that tell each other their landmarks: the
// exchange of keyframes without images, so that thousands of fusions take seconds.
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/camera_pose.h"
#include "estimator/so3.h"
#include "tests/estimator/filter_run.h"

namespace covey {

struct TeamFlight {
  Scenario scenario = Scenario::kCastleParallel;
  double duration_s = 15;
  std::vector<double> pixel_sigma{0.7, 0.7};  // px, of each drone: it says who knows more
  double matching_sigma_px = 0.7;
  double keyframe_interval_s = 0.5;
  bool collaborate = true;
  double wrong_share = 0;     // of the matches of each message
  double answer_delay_s = 0;  // from the keyframe that is asked about to what is matched with it
  EstimatorConfig config;
};

struct TeamRun {
  std::vector<FilterRun> drones;
  PeerReport fused;
  int messages = 0, messages_used = 0;
  int longest_alike = 0;
};

// What a drone saw at one of its keyframes and knew of it then.
struct StoredKeyframe {
  KeyframePose pose;
  struct Landmark {
    std::uint64_t track_id = 0;
    Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
    double inverse_depth = 0, inverse_depth_sigma = 0;
  };
  std::map<std::size_t, Landmark> seen;  // by index of the true landmark
};

class TeamMember {
 public:
  TeamMember(DroneFeatures drone, const EstimatorConfig& config, std::uint64_t seed)
      : drone_(std::move(drone)), estimator_(with_extrinsics(config, drone_)) {
    estimator_.initialize(disturbed_start(drone_, drone_.truth.front().bias, seed));
  }

  [[nodiscard]] std::size_t images() const { return drone_.camera.size(); }
  [[nodiscard]] const DroneFeatures& drone() const { return drone_; }
  [[nodiscard]] const std::deque<StoredKeyframe>& keyframes() const { return keyframes_; }
  [[nodiscard]] Estimator& estimator() { return estimator_; }
  [[nodiscard]] FilterRun& run() { return run_; }

  void fly_to(std::size_t image) {
    const CameraMeasurement& camera = drone_.camera[image];
    while (next_imu_ < drone_.imu.size() &&
           drone_.imu[next_imu_].stamp_ns <= camera.stamp_ns + 40'000'000) {
      estimator_.add_imu(drone_.imu[next_imu_++]);
    }
    const UpdateReport report = estimator_.add_camera(camera);
    run_.reinitialized += report.reinitialized ? 1 : 0;
    run_.refused += report.propagated ? 0 : 1;
    run_.used += report.slam_used + report.msckf_used;
    run_.gated += report.slam_gated + report.msckf_gated;
  }

  void record() {
    const Odometry odometry = estimator_.odometry();
    run_.covariance_valid = run_.covariance_valid && odometry.pose_covariance.allFinite() &&
                            odometry.pose_covariance.llt().info() == Eigen::Success;
    run_.errors.push_back(compare(odometry, drone_));
  }

  void store_keyframe(std::size_t image) {
    constexpr std::size_t kKept = 30;
    const CameraMeasurement& measurement = drone_.camera[image];
    const std::optional<CameraEstimate> camera = estimator_.camera();
    if (!camera) return;
    StoredKeyframe keyframe;
    keyframe.pose = {next_keyframe_id_++, measurement.stamp_ns, camera->T_world_cam,
                     camera->covariance};
    std::map<std::uint64_t, TrackDepth> depths;
    for (const TrackDepth& depth : estimator_.depths()) depths[depth.track_id] = depth;
    for (const TrackObservation& seen : measurement.tracks) {
      StoredKeyframe::Landmark landmark{seen.track_id, seen.bearing, 0, 0};
      if (const auto known = depths.find(seen.track_id); known != depths.end()) {
        landmark.inverse_depth = known->second.inverse_depth;
        landmark.inverse_depth_sigma = known->second.inverse_depth_sigma;
      }
      keyframe.seen[drone_.landmark_of_track.at(seen.track_id)] = landmark;
    }
    keyframes_.push_front(std::move(keyframe));
    if (keyframes_.size() > kKept) keyframes_.pop_back();
  }

 private:
  static EstimatorConfig with_extrinsics(EstimatorConfig config, const DroneFeatures& drone) {
    config.extrinsics = drone.extrinsics;
    return config;
  }

  DroneFeatures drone_;
  Estimator estimator_;
  FilterRun run_;
  std::size_t next_imu_ = 0;
  std::uint64_t next_keyframe_id_ = 1;
  std::deque<StoredKeyframe> keyframes_;  // newest first
};

inline Eigen::Isometry3d true_camera(const DroneFeatures& drone, TimeNs stamp_ns) {
  const double time_s = seconds_between(drone.imu.front().stamp_ns, stamp_ns);
  return camera_in_world(drone.trajectory.pose_at(time_s), drone.extrinsics);
}

// The newest own keyframe against the peer's that shares most with it; T_other_own as roughly as
// geometric verification finds it.
inline KeyframeMatch match_keyframes(const TeamMember& own, const TeamMember& peer,
                                     const TeamFlight& flight, Random& random) {
  constexpr double kMaxRelativeSigma = 0.3;
  const StoredKeyframe& mine = own.keyframes().front();
  KeyframeMatch best;
  for (const StoredKeyframe& theirs : peer.keyframes()) {
    KeyframeMatch match;
    match.drone = peer.drone().name;
    match.own = mine.pose;
    match.other = theirs.pose;
    const double sigma = flight.matching_sigma_px / FeatureCamera{}.focal_px;
    for (const auto& [index, theirs_seen] : theirs.seen) {
      const auto found = mine.seen.find(index);
      if (found == mine.seen.end() || !(theirs_seen.inverse_depth > 0) ||
          theirs_seen.inverse_depth_sigma > kMaxRelativeSigma * theirs_seen.inverse_depth) {
        continue;
      }
      LandmarkMatch one;
      one.track_id = found->second.track_id;
      one.bearing = found->second.bearing;
      one.other_bearing = theirs_seen.bearing;
      one.inverse_depth = theirs_seen.inverse_depth;
      one.inverse_depth_sigma = theirs_seen.inverse_depth_sigma;
      one.bearing_covariance = sigma * sigma * Eigen::Matrix2d::Identity();
      match.matches.push_back(one);
    }
    if (match.matches.size() > best.matches.size()) best = match;
  }
  for (std::size_t i = 0; i + 1 < best.matches.size(); ++i) {
    if (random.unit() < flight.wrong_share) {
      std::swap(best.matches[i].track_id, best.matches[i + 1].track_id);
    }
  }
  best.T_other_own = true_camera(peer.drone(), best.other.stamp_ns).inverse() *
                     true_camera(own.drone(), best.own.stamp_ns);
  best.T_other_own.translation() += 0.05 * random.gaussian_vector();
  best.T_other_own.linear() = exp_so3(0.005 * random.gaussian_vector()) * best.T_other_own.linear();
  return best;
}

inline void tell(TeamMember& own, const KeyframeMatch& match, TeamRun& run) {
  constexpr std::size_t kMinMatches = 8;
  if (match.matches.size() < kMinMatches) return;
  const PeerReport report = own.estimator().add_peer(match);
  ++run.messages;
  run.messages_used += report.used > 0 ? 1 : 0;
  run.fused.used += report.used;
  run.fused.gated += report.gated;
  run.fused.invalid += report.invalid;
  run.fused.unknown_track += report.unknown_track;
  run.fused.uninformative += report.uninformative;
}

inline std::vector<TeamMember> team_of(const TeamFlight& flight, std::uint64_t seed) {
  std::vector<TeamMember> team;
  const int agents = static_cast<int>(flight.pixel_sigma.size());
  for (int i = 0; i < agents; ++i) {
    FeatureScenario scenario;
    scenario.flight.scenario = flight.scenario;
    scenario.flight.agents = agents;
    scenario.flight.duration_s = flight.duration_s;
    scenario.camera.first_image_s = 0.1023;  // never on an IMU sample
    scenario.camera.pixel_sigma = flight.pixel_sigma[static_cast<std::size_t>(i)];
    EstimatorConfig config = flight.config;
    config.imu_noise = scenario.imu.noise;
    team.emplace_back(simulate_features(scenario, seed).drones[static_cast<std::size_t>(i)], config,
                      seed * 100 + static_cast<std::uint64_t>(i));
  }
  return team;
}

inline TeamRun fly(const TeamFlight& flight, std::uint64_t seed) {
  std::vector<TeamMember> team = team_of(flight, seed);
  Random random(seed, 0x7ea3);
  TeamRun run;
  const auto images_of = [](double seconds) {
    return static_cast<std::size_t>(std::lround(seconds * FeatureCamera{}.rate_hz));
  };
  const std::size_t keyframe_every = images_of(flight.keyframe_interval_s);
  struct Answer {
    std::size_t due_image = 0, own = 0;
    KeyframeMatch match;
  };
  std::deque<Answer> under_way;
  for (std::size_t image = 0; image < team.front().images(); ++image) {
    for (TeamMember& member : team) member.fly_to(image);
    if (flight.collaborate && image % keyframe_every == 0) {
      for (TeamMember& member : team) member.store_keyframe(image);
      for (std::size_t own = 0; own < team.size(); ++own) {
        for (std::size_t peer = 0; peer < team.size(); ++peer) {
          if (own == peer) continue;
          under_way.push_back({image + images_of(flight.answer_delay_s), own,
                               match_keyframes(team[own], team[peer], flight, random)});
        }
      }
    }
    for (; !under_way.empty() && under_way.front().due_image <= image; under_way.pop_front()) {
      tell(team[under_way.front().own], under_way.front().match, run);
    }
    for (TeamMember& member : team) member.record();
  }
  for (TeamMember& member : team) run.drones.push_back(std::move(member.run()));
  return run;
}

}  // namespace covey
