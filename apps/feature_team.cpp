// SPDX-License-Identifier: Apache-2.0
#include "apps/feature_team.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <utility>

#include "apps/central_filter.h"
#include "apps/process_usage.h"
#include "apps/split_intersection.h"
#include "estimator/relative_pose.h"

namespace covey {
namespace {

void record(TeamMember& member, const Odometry& odometry, const Pose& truth) {
  member.path.odometry.push_back(odometry);
  member.path.truth.push_back(truth);
}

void count(const std::string& drone, const std::string& own_name, bool used, bool gated,
           TeamMember& member) {
  member.used += used ? 1 : 0;
  member.gated += gated ? 1 : 0;
  if (used && drone != own_name) member.peers.insert(drone);
}

// Flights that were flown, with a corrector beside each that has add_own() and corrected();
// `fuse(i, match, member)` gives drone i a match and returns the relative pose if that was used,
// `tell(i, found, members)` passes on what came of an answer.
template <typename Corrector, typename Fuse, typename Tell>
std::vector<TeamMember> exchange_all(const SoloTeam& team, FeatureExchange& exchange,
                                     std::vector<Corrector>& correctors, const Fuse& fuse,
                                     const Tell& tell, const AfterImage& after_image) {
  std::vector<TeamMember> members(team.names.size());
  const auto timed = [&](std::size_t i, const auto& work) {
    const double start_ms = thread_cpu_ms();
    work();
    members[i].fusion_cpu_ms += thread_cpu_ms() - start_ms;
  };
  for (std::size_t k = 0; k < team.flights.front().size(); ++k) {
    for (std::size_t i = 0; i < members.size(); ++i) {
      const FlownImage& image = team.flights[i][k];
      if (image.keyframe) {
        correctors[i].add_own(image.keyframe->pose);
        exchange.add_keyframe(i, *image.keyframe);
        const std::vector<KeyframeMatch> matches = exchange.revisit(i);
        timed(i, [&] {
          for (const KeyframeMatch& match : matches) (void)fuse(i, match, members[i]);
        });
      }
      Odometry corrected;
      timed(i, [&] { corrected = correctors[i].corrected(image.alone); });
      record(members[i], corrected, image.truth);
    }
    // Answers come after the image.
    for (std::size_t i = 0; i < members.size(); ++i) {
      if (!team.flights[i][k].keyframe) continue;
      for (const KeyframeMatch& match : exchange.ask(i)) {
        std::optional<RelativePose> found;
        timed(i, [&] { found = fuse(i, match, members[i]); });
        if (found) tell(i, *found, members);
      }
    }
    if (after_image) after_image();
  }
  for (std::size_t i = 0; i < members.size(); ++i) members[i].traffic = exchange.traffic(i);
  return members;
}

CentralStart take_over(const FilterSnapshot& filter, const CameraExtrinsics& extrinsics) {
  const Eigen::VectorXd& x = filter.state;
  CentralStart start;
  start.imu.stamp_ns = filter.stamp_ns;
  start.imu.pose.p_world_imu = x.head<3>();
  start.imu.v_world_imu = x.segment<3>(3);
  start.imu.pose.q_world_imu = Eigen::Quaterniond(Eigen::Vector4d(x.segment<4>(6)));
  start.imu.gyro_bias = x.segment<3>(10);
  start.imu.accel_bias = x.segment<3>(13);
  start.covariance = filter.covariance.topLeftCorner<State::kImuSize, State::kImuSize>();
  start.extrinsics = extrinsics;
  return start;
}

// Some of the drones in one central filter.
class CentralFlight {
 public:
  CentralFlight(const FeatureSimulation& simulation, std::vector<std::size_t> drones,
                const CentralConfig& config, const std::vector<CentralStart>& starts)
      : simulation_(simulation),
        drones_(std::move(drones)),
        filter_(config, starts),
        next_imu_(drones_.size()) {}

  void fly(std::size_t image, std::vector<TeamMember>& members) {
    constexpr TimeNs kBeyondImage_ns = 40'000'000;
    std::vector<CentralFilter::Image> images;
    for (std::size_t i = 0; i < drones_.size(); ++i) {
      const DroneFeatures& drone = simulation_.drones[drones_[i]];
      feed_imu(i, drone.camera[image].stamp_ns + kBeyondImage_ns);
      images.push_back(image_of(drone, image));
    }
    filter_.add_images(images);
    for (std::size_t i = 0; i < drones_.size(); ++i) {
      const DroneFeatures& drone = simulation_.drones[drones_[i]];
      record(members[drones_[i]], filter_.odometry(i), drone.truth[image].state.pose);
    }
  }

 private:
  void feed_imu(std::size_t i, TimeNs until_ns) {
    const std::vector<ImuSample>& imu = simulation_.drones[drones_[i]].imu;
    while (next_imu_[i] < imu.size() && imu[next_imu_[i]].stamp_ns <= until_ns) {
      filter_.add_imu(i, imu[next_imu_[i]++]);
    }
  }

  static CentralFilter::Image image_of(const DroneFeatures& drone, std::size_t k) {
    CentralFilter::Image image{drone.camera[k], {}};
    for (const TrackObservation& track : image.camera.tracks) {
      image.landmarks.push_back(drone.landmark_of_track.at(track.track_id));
    }
    return image;
  }

  const FeatureSimulation& simulation_;
  std::vector<std::size_t> drones_;
  CentralFilter filter_;
  std::vector<std::size_t> next_imu_;
};

}  // namespace

SoloTeam fly_team_alone(const FeatureSimulation& simulation, const EstimatorConfig& config,
                        const KeyframeRule& rule, std::uint64_t seed,
                        const AfterImage& after_image) {
  SoloTeam team;
  for (std::size_t i = 0; i < simulation.drones.size(); ++i) {
    const DroneFeatures& drone = simulation.drones[i];
    team.names.push_back(drone.name);
    team.flights.push_back(fly_alone(drone, config, rule, seed * 100 + i, after_image));
  }
  return team;
}

std::vector<TeamMember> alone(const SoloTeam& team) {
  std::vector<TeamMember> members(team.names.size());
  for (std::size_t i = 0; i < members.size(); ++i) {
    for (const FlownImage& image : team.flights[i]) record(members[i], image.alone, image.truth);
  }
  return members;
}

std::vector<TeamMember> fuse_jointly(const SoloTeam& team, FeatureExchange exchange,
                                     const DriftConfig& drift, int min_matches,
                                     const AfterImage& after_image) {
  std::vector<DriftFilter> filters;
  for (const std::string& name : team.names) filters.emplace_back(drift, name);
  const auto use = [&](std::size_t i, const RelativePose& relative, TeamMember& member) {
    const DriftOutcome outcome = filters[i].add(relative);
    count(relative.drone, team.names[i], outcome == DriftOutcome::kUsed,
          outcome == DriftOutcome::kGated, member);
    return outcome == DriftOutcome::kUsed;
  };
  const auto fuse = [&](std::size_t i, const KeyframeMatch& match, TeamMember& member) {
    auto relative = estimate_relative_pose(match, min_matches);
    if (relative && !use(i, *relative, member)) relative.reset();
    return relative;
  };
  const auto tell = [&](std::size_t i, const RelativePose& found,
                        std::vector<TeamMember>& members) {
    const auto told = exchange.tell(i, found);
    if (told) (void)use(told->drone, told->found, members[told->drone]);
  };
  return exchange_all(team, exchange, filters, fuse, tell, after_image);
}

std::vector<TeamMember> fuse_by_split_intersection(const SoloTeam& team, FeatureExchange exchange,
                                                   int min_matches, const AfterImage& after_image) {
  std::vector<SplitIntersection> filters(team.names.size());
  const auto fuse = [&](std::size_t i, const KeyframeMatch& match, TeamMember& member) {
    const auto relative = estimate_relative_pose(match, min_matches);
    if (!relative) return std::optional<RelativePose>();
    const auto other = static_cast<std::size_t>(std::distance(
        team.names.begin(), std::find(team.names.begin(), team.names.end(), match.drone)));
    const std::optional<DriftEstimate> theirs = filters[other].at(match.other.keyframe_id);
    const bool used = theirs && filters[i].fuse(*relative, *theirs);
    count(match.drone, team.names[i], used, !used, member);
    return used ? relative : std::nullopt;
  };
  const auto tell_nobody = [](std::size_t, const RelativePose&, std::vector<TeamMember>&) {};
  return exchange_all(team, exchange, filters, fuse, tell_nobody, after_image);
}

std::vector<TeamMember> fuse_by_intersection(const FeatureSimulation& simulation,
                                             const EstimatorConfig& config,
                                             const KeyframeRule& rule, std::uint64_t seed,
                                             FeatureExchange exchange,
                                             const AfterImage& after_image) {
  std::vector<TeamMember> members(simulation.drones.size());
  std::vector<FeatureFlight> flights;
  for (std::size_t i = 0; i < members.size(); ++i) {
    flights.emplace_back(simulation.drones[i], config, rule, seed * 100 + i);
  }
  while (!flights.front().ended()) {
    std::vector<bool> asks(members.size());
    for (std::size_t i = 0; i < members.size(); ++i) {
      const FlownImage image = flights[i].next();
      record(members[i], image.alone, image.truth);
      asks[i] = image.keyframe.has_value();
      if (image.keyframe) exchange.add_keyframe(i, *image.keyframe);
    }
    for (std::size_t i = 0; i < members.size(); ++i) {
      if (!asks[i]) continue;
      const double start_ms = thread_cpu_ms();
      for (const KeyframeMatch& match : exchange.ask(i)) {
        const PeerReport report = flights[i].fuse(match);
        members[i].used += report.used > 0 ? 1 : 0;
        members[i].gated += report.used == 0 && report.gated > 0 ? 1 : 0;
      }
      members[i].fusion_cpu_ms += thread_cpu_ms() - start_ms;
    }
    if (after_image) after_image();
  }
  for (std::size_t i = 0; i < members.size(); ++i) members[i].traffic = exchange.traffic(i);
  return members;
}

std::vector<TeamMember> fuse_centrally(const FeatureSimulation& simulation,
                                       const EstimatorConfig& config, const KeyframeRule& rule,
                                       std::uint64_t seed,
                                       const std::vector<std::vector<std::size_t>>& groups,
                                       double own_start_s, const AfterImage& after_image) {
  const std::vector<CameraMeasurement>& stamps = simulation.drones.front().camera;
  const TimeNs takeover_ns = stamps.front().stamp_ns + nanoseconds(own_start_s);
  std::vector<TeamMember> members(simulation.drones.size());
  CentralConfig central;
  central.estimator = config;
  for (const std::vector<std::size_t>& group : groups) {
    std::vector<CentralStart> starts;
    std::size_t k = 0;
    for (const std::size_t i : group) {
      FeatureFlight flight(simulation.drones[i], config, rule, seed * 100 + i);
      for (k = 0; k < stamps.size() && stamps[k].stamp_ns <= takeover_ns; ++k) {
        const FlownImage image = flight.next();
        record(members[i], image.alone, image.truth);
      }
      starts.push_back(take_over(flight.snapshot(), simulation.drones[i].extrinsics));
    }
    CentralFlight flight(simulation, group, central, starts);
    for (; k < stamps.size(); ++k) {
      flight.fly(k, members);
      if (after_image) after_image();
    }
  }
  return members;
}

}  // namespace covey
