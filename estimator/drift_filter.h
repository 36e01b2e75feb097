// SPDX-License-Identifier: Apache-2.0
//
// What a team knows together: how far the own odometry and those of the peers have drifted by the
// keyframes that they have in common. A small Kalman filter beside the drone's own one, which never
// learns of it: so every drone's odometry stays independent of all others', and what a peer says
// counts once, however often it is heard.
//
// State: the pose errors e of keyframes, of all drones (DriftState). Two keyframes that see the
// same landmarks give e_own - e_other, of two drones or of one that returns, whichever of the two
// has found the other's; and where both have measured their depths, by how much more the one's
// odometry is wrong over the way on which it did than the other's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "estimator/drift_observation.h"
#include "estimator/drift_state.h"
#include "estimator/measurements.h"
#include "estimator/peer_claims.h"
#include "estimator/relative_pose.h"
#include "estimator/world_vote.h"

namespace covey {

struct DriftConfig {
  int max_keyframes = 100;         // in the state
  double gate_confidence = 0.999;  // share of good relative poses that pass the chi-square gate
  PeerClaimsConfig claims;
  // Relative poses to the landmarks of one keyframe are wrong alike, the less the longer ago the
  // other one saw them: exp(-time / same_landmarks_s). To landmarks of different keyframes of one
  // drone they are wrong alike by this share of it, and not at all where the one drone has found
  // the other's landmarks and the other the one's.
  double same_landmarks_s = 2.0;  // s
  double other_landmarks_share = 0.2;
  // Do all drones start in one world? If not, each peer's world is aligned first. Either way a
  // world is aligned anew once relative poses that do not fit it, with none between them that does,
  // agree on another as well as `alignment` asks for; but not more often than that: who moves on
  // and on is not believed.
  bool common_start = true;
  int max_moves = 3;
  // Of where a peer starts in a common world, seen from the own start, and of its heading there
  // (standard deviations). 0: exactly where it says.
  double start_position_sigma_m = 0;  // m
  double start_yaw_sigma = 0;         // rad
  // Depths are as wrong as the way on which they were measured, if that took so long: those of the
  // first moments of a flight are wrong in ways of their own and are not compared.
  double least_depth_memory_s = 3.0;  // s
  WorldVoteConfig alignment;
  int max_drones = 64;  // who invents more names is not heard
};

enum class DriftOutcome : std::uint8_t {
  kUsed,
  kMoved,  // used, and the peer's world lies elsewhere than was believed
  kGated,
  kUnaligned,
  kRepeated,
  kInvalid
};

// A peer's world in the own one, as a common keyframe has it.
struct WorldAlignment {
  Eigen::Isometry3d T_own_peer = Eigen::Isometry3d::Identity();
  Eigen::Vector3d p_peer = Eigen::Vector3d::Zero();  // m, of that keyframe, in the peer's world
  double position_sigma = 0;                         // m, largest, there
  double yaw_sigma = 0;                              // rad
};

class DriftFilter {
 public:
  DriftFilter(const DriftConfig& config, std::string own_name);

  // Every own keyframe: how sure the own odometry was at what time.
  void add_own(const KeyframePose& pose);
  DriftOutcome add(const RelativePose& measurement);

  // All that a peer has said, since it began another flight. add() sees that by itself where a
  // keyframe of the peer that is in the state is older and its id not lower; relative poses that
  // wait for the peer's world to be found do not show it.
  void forget_drone(const std::string& peer);

  // The odometry's output with the present drift taken out.
  [[nodiscard]] Odometry corrected(const Odometry& alone) const;

  // Nothing while the peer's world is not known or nothing of it has been used. By the peer's
  // newest keyframe: where it is now, its drift taken out.
  [[nodiscard]] std::optional<WorldAlignment> alignment(const std::string& peer) const;
  // By its oldest: where its world lies, before it had drifted far.
  [[nodiscard]] std::optional<WorldAlignment> alignment_at_start(const std::string& peer) const;
  // How often a peer's world was found to lie elsewhere than was believed.
  [[nodiscard]] int moves(const std::string& peer) const;
  [[nodiscard]] std::vector<std::string> peers() const;  // that were ever heard
  [[nodiscard]] int keyframes() const { return state_.keyframes(); }
  // Of the pose errors of all keyframes in the state, [dp dtheta] each.
  [[nodiscard]] Eigen::MatrixXd covariance() const { return state_.covariance(); }

 private:
  // A peer's world in the own one: nominal, error part of the peer's nodes.
  struct World {
    bool known = false;
    Eigen::Isometry3d T_own_peer = Eigen::Isometry3d::Identity();
    // m, where the alignment was found; in a common start, where the own drone began.
    Eigen::Vector3d pivot = Eigen::Vector3d::Zero();
    Matrix6d covariance = Matrix6d::Zero();  // at the pivot
  };
  // What of a relative pose tells how much another one repeats it.
  struct UsedPose {
    bool found_by_other = false;
    std::uint64_t landmarks_of = 0;  // keyframe
    TimeNs found_ns = 0;             // stamp of the image in which they were found
    TimeNs own_stamp_ns = 0;
  };
  struct Drone {
    std::string name;
    World world;
    WorldVote vote;             // while the world is known: against it
    std::deque<UsedPose> used;  // the newest
    int moves = 0;              // of the world, since it was known first
  };
  [[nodiscard]] Drone newcomer(const std::string& name) const;
  [[nodiscard]] std::vector<int> nodes_of(const std::string& peer) const;  // rising stamps
  [[nodiscard]] WorldAlignment alignment_by(int index) const;
  [[nodiscard]] std::optional<std::size_t> drone_index(const std::string& name);
  // A keyframe of a later flight than what is known of the drone ends that: all of it is forgotten.
  // False if the keyframe is itself of an earlier one.
  [[nodiscard]] bool is_of_present_flight(std::size_t drone, const KeyframePose& keyframe);
  [[nodiscard]] DriftState::Node to_node(std::size_t drone, const KeyframePose& pose) const;
  [[nodiscard]] static UsedPose to_used(const RelativePose& measurement);
  // By how much more uncertain a relative pose is because it is not the first of its kind.
  [[nodiscard]] double repetition(const Drone& drone, const UsedPose& pose) const;
  // Has the drone said all that is believed of it about this own keyframe?
  [[nodiscard]] bool said_enough(const Drone& drone, const UsedPose& pose) const;
  void count_used(Drone& drone, const UsedPose& pose);
  // Of the share by which depths measured on a way are wrong otherwise than the way itself.
  [[nodiscard]] static double unshared_scale_variance(const DriftState::Node& from,
                                                      const DriftState::Node& to);
  // A keyframe of a relative pose in the state, and the one since which its drone measured depths.
  struct Side {
    int at = 0, before = 0;  // nodes; the same where depths do not matter
    ObservedKeyframe keyframe;
  };
  struct Sides {
    Side own, other;
  };
  [[nodiscard]] Side side_of(int at, int before) const;
  [[nodiscard]] Sides insert_sides(std::size_t drone, const RelativePose& measurement,
                                   bool with_ratio);
  // None if the ratio of the depths says nothing of both drones' odometry.
  [[nodiscard]] const DepthRatio* usable_ratio(const RelativePose& measurement) const;
  // False if none of them could be used: then its world is a newcomer's.
  bool align(std::size_t drone, const std::vector<RelativePose>& agreeing);
  // What became of one that does not fit a world that is known.
  DriftOutcome contradict(std::size_t drone, const RelativePose& measurement);
  // Unless it is used, nothing changes.
  DriftOutcome use(std::size_t drone, const RelativePose& measurement);
  // `repetition`: of its noise. Leaves keyframes in the state though they were of no use.
  DriftOutcome fuse(std::size_t drone, const RelativePose& measurement, double repetition);

  DriftConfig config_;
  double gate_limit_, gate_limit_with_ratio_;
  std::vector<Drone> drones_;  // first the own one
  DriftState state_;
  PeerClaims claims_;
  std::optional<Eigen::Vector3d> p_own_start_;
};

}  // namespace covey
