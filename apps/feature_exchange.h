// SPDX-License-Identifier: Apache-2.0
//
// What the drones of a simulated team tell each other: who asks, who answers how often and with
// what, as Collaborator and PeerLink have it, every message through its bytes. Which corners are
// the same point is known, not found; but the corners of two drones do not coincide.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "apps/feature_flight.h"
#include "estimator/measurements.h"
#include "estimator/relative_pose.h"
#include "frontend/answer_limiter.h"
#include "frontend/collaborator.h"

namespace covey {

// Which landmarks are sent and matched: SLAM features, tracks in the filter's window, or both.
enum class SharedLandmarks { kAll, kSlam, kWindow };

// What a drone says of itself beside the truth as it knows it.
struct Falsehood {
  Eigen::Vector3d offset_world = Eigen::Vector3d::Zero();  // m, of its poses
  double claimed_sigmas = 1;                               // times those that it has
};

struct FeatureExchangeConfig {
  CollaboratorConfig limits;  // how often and how much; nothing of places and matching
  SharedLandmarks landmarks = SharedLandmarks::kAll;
  bool own_loops = true;         // a drone's own older keyframes
  double bearing_sigma = 1e-3;   // of a measured bearing, normalised plane
  double corner_mismatch = 0.0;  // standard deviation of the constant offset between two tracks'
                                 // corners on one landmark, either component, normalised plane
  std::uint64_t seed = 1;        // of the mismatches
  int copies = 1;                // of each answer, that arrive
};

struct Traffic {
  std::size_t advert_bytes = 0;  // of questions, each counted once
  std::size_t answer_bytes = 0;  // and what came of others'
};

class FeatureExchange {
 public:
  FeatureExchange(const FeatureExchangeConfig& config, std::vector<std::string> names);

  void silence(std::size_t drone) { drones_[drone].silent = true; }
  void falsify(std::size_t drone, const Falsehood& falsehood);

  void add_keyframe(std::size_t drone, const FlownKeyframe& keyframe);
  // The newest keyframe against what the drone has already, at no bytes.
  [[nodiscard]] std::vector<KeyframeMatch> revisit(std::size_t drone) const;
  // The newest keyframe asked of all others, unless one from nearly there was; their answers,
  // matched.
  [[nodiscard]] std::vector<KeyframeMatch> ask(std::size_t drone);

  // What a drone has found of a peer's keyframe, as that peer hears it.
  struct Told {
    std::size_t drone = 0;  // who hears it
    RelativePose found;     // from its side
  };
  [[nodiscard]] std::optional<Told> tell(std::size_t drone, const RelativePose& found);

  [[nodiscard]] const Traffic& traffic(std::size_t drone) const { return drones_[drone].traffic; }

 private:
  // A keyframe with what was sent of it, or could be.
  struct Sight {
    std::size_t drone = 0;
    KeyframePose pose, before;  // as its drone says
    Eigen::Isometry3d T_world_cam_true = Eigen::Isometry3d::Identity();
    double mean_depth = 1;
    std::vector<FlownFeature> landmarks;  // with depth, rising landmarks
  };
  struct Drone {
    std::string name;
    bool silent = false;
    Falsehood falsehood;
    AnswerLimiter limiter;
    std::optional<KeyframePose> last_asked;
    QuestionsSoFar questions;
    bool asks_briefly = false;  // in its newest question
    std::deque<FlownKeyframe> keyframes;
    std::deque<Sight> remembered;  // of peers
    Traffic traffic;
  };

  void count_question(Drone& self, const FlownKeyframe& keyframe) const;
  [[nodiscard]] Sight sight_of(std::size_t drone, const FlownKeyframe& keyframe) const;
  [[nodiscard]] std::optional<Sight> best_answer(std::size_t drone, const std::string& asker,
                                                 const FlownKeyframe& seen) const;
  void keep_most_useful(Sight& sight, const FlownKeyframe& seen, std::size_t most) const;
  // Through bytes and back, as its sender has it; nothing if the link would refuse it.
  [[nodiscard]] std::optional<PeerKeyframe> deliver(std::size_t sender, PeerKeyframe message);
  [[nodiscard]] std::optional<Sight> send(std::size_t receiver, std::uint64_t request,
                                          const Sight& sight);
  [[nodiscard]] std::optional<KeyframeMatch> match(std::size_t drone, const FlownKeyframe& own,
                                                   const Sight& other) const;
  [[nodiscard]] Eigen::Vector2d mismatch(std::size_t drone, std::uint64_t track,
                                         std::size_t other_drone, std::uint64_t other_track) const;

  FeatureExchangeConfig config_;
  std::vector<Drone> drones_;
};

}  // namespace covey
