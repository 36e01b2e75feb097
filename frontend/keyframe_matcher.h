// SPDX-License-Identifier: Apache-2.0
//
// Where an own keyframe sees the landmarks of another one, a peer's or an older one of the own.
// What they look like is searched for where the poses put them; if too few are there, because the
// worlds have drifted apart or are unknown to each other, descriptors say which corners are the
// same, if they came along, and geometry which of those to believe. Then all of them are searched
// for once more.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "frontend/feature_matching.h"
#include "frontend/geometric_verification.h"
#include "frontend/image_pyramid.h"
#include "frontend/keyframe_database.h"
#include "frontend/landmark_patch.h"
#include "frontend/place_recognition.h"

namespace covey {

struct KeyframeMatcherConfig {
  double max_relative_sigma = 0.3;  // landmarks less certain than this share of their distance are
                                    // neither sent nor accepted
  int min_matches = 8;              // fewer are no matches
  bool common_start = true;         // are all worlds one but for drift, or unknown until told?
  // Of a peer's world seen from the own start, until it is known; about z.
  double start_position_sigma = 0;  // m
  double start_yaw_sigma = 0;       // rad
  // By descriptor.
  MatchingConfig descriptors;
  VerificationConfig verification;
  GuidedConfig guided;
  double drift_px = 40;   // by which two drones' worlds may look shifted, in a first attempt
  double sigma_px = 0.7;  // to which two drones agree on a corner; a fatter tail than Gaussian
  // By what they look like.
  PatchSearchConfig patch;
  double aligned_sigma_px = 0.05;  // of what is found, beside what its alignment claims
  double aligned_scale = 1.5;      // by which errors are larger than that claims
  double in_place_px = 1.0;        // to which those agree that are found where they are expected,
  double in_place_share = 0.5;     // and this share of them
  std::size_t images = 20;         // of the newest keyframes, each 0.5 MB
};

enum class NoMatchReason : std::uint8_t {
  kNotForUs,        // another receiver, or our own message come back
  kMalformed,       // too many landmarks, or not finite
  kUnknownRequest,  // the asking keyframe is not (or no longer) stored
  kTooFewMatches,   // by descriptor, or in the end
  kTooFewInliers,   // by geometry
  kOffsetTooLarge,  // the two worlds do not agree
  kTooFewFound,     // of the landmarks in sight: what looks alike may be another place
};
inline constexpr std::size_t kNoMatchReasons = 7;

struct NoMatch {
  NoMatchReason reason = NoMatchReason::kMalformed;
};

[[nodiscard]] const char* to_string(NoMatchReason reason);

[[nodiscard]] bool is_certain(double inverse_depth, double inverse_depth_sigma,
                              double max_relative_sigma);

// Those features or landmarks whose depth is certain.
[[nodiscard]] std::vector<KeyframeFeature> landmarks_of(const Keyframe& keyframe,
                                                        double max_relative_sigma);
[[nodiscard]] std::vector<PeerLandmark> landmarks_of(const PeerKeyframe& keyframe,
                                                     double max_relative_sigma);

// What the own drone knows of a landmark's depth, if it is certain.
template <typename Feature>
void add_own_depth(const Feature& own, double max_relative_sigma, LandmarkMatch& match) {
  if (!is_certain(own.inverse_depth, own.inverse_depth_sigma, max_relative_sigma)) return;
  match.own_inverse_depth = own.inverse_depth;
  match.own_inverse_depth_sigma = own.inverse_depth_sigma;
}

[[nodiscard]] ShortDescriptor shortened(const BinaryDescriptor& descriptor);

class KeyframeMatcher {
 public:
  KeyframeMatcher(const KeyframeMatcherConfig& config, const CameraIntrinsics& camera);

  void set_intrinsics(const CameraIntrinsics& camera) { camera_ = camera; }  // as known by now

  void note_start(const Eigen::Vector3d& p_world) { p_start_ = p_world; }  // of the own drone

  // Of the newest own keyframes; those without an image are matched by descriptor alone.
  void keep_image(std::uint64_t keyframe_id, const ImagePyramid& image);

  // Where a drone's world lies in the own one, as far as that is known by now.
  void know_world(const std::string& drone, const Eigen::Isometry3d& T_own_drone);
  // Where it may lie: until it is known, what the drone has seen is looked for there as well.
  void suppose_world(const std::string& drone, const Eigen::Isometry3d& T_own_drone);

  // Keyframes count up, so a drone of known world whose count falls has started anew.
  [[nodiscard]] bool has_started_anew(const std::string& drone, std::uint64_t keyframe_id) const;
  // Forgets the world of a drone that has.
  void note_keyframe(const std::string& drone, std::uint64_t keyframe_id);

  // None while it is not known.
  [[nodiscard]] std::optional<Eigen::Isometry3d> world_of(const std::string& drone) const;
  // Or else as it was supposed to lie.
  [[nodiscard]] std::optional<Eigen::Isometry3d> likely_world_of(const std::string& drone) const;
  // m, of what it has seen at an own place; zero once its world is known.
  [[nodiscard]] double start_sigma_at(const std::string& drone,
                                      const Eigen::Vector3d& p_world) const;
  // rad, likewise.
  [[nodiscard]] double start_yaw_sigma(const std::string& drone) const;

  // `other`: whoever it was sent to; of an own one, what a peer would be told.
  [[nodiscard]] std::variant<KeyframeMatch, NoMatch> match(const Keyframe& own,
                                                           const PeerKeyframe& other) const;

 private:
  [[nodiscard]] bool knows_world(const std::string& drone) const;
  // Where a landmark of the other one was looked for in the own image, and what was found there.
  struct Search {
    std::optional<Eigen::Vector2d> expected;  // bearing; none: not looked for
    std::optional<FoundPatch> found;
  };
  // One for each landmark; `searches` that were made already nearly there are kept.
  [[nodiscard]] std::vector<Search> look_for(std::uint64_t own_keyframe, const PeerKeyframe& other,
                                             const std::vector<PeerLandmark>& landmarks,
                                             const Eigen::Isometry3d& T_other_own,
                                             std::vector<Search> searches) const;
  // Where the other's pose puts them. None while nobody knows where its world may lie.
  [[nodiscard]] std::vector<Search> look_where_expected(
      const Keyframe& own, const PeerKeyframe& other,
      const std::vector<PeerLandmark>& landmarks) const;
  // How far off the other's points may be, too.
  [[nodiscard]] VerificationConfig limits(const Keyframe& own, const std::string& other) const;
  [[nodiscard]] VerificationResult verify_in_place(const Keyframe& own,
                                                   const std::vector<PeerPoint>& points,
                                                   const std::vector<Search>& searches,
                                                   VerificationConfig config) const;
  [[nodiscard]] VerificationResult verify_pairs(const Keyframe& own,
                                                const std::vector<OwnFeature>& features,
                                                const std::vector<PeerPoint>& points,
                                                const VerificationConfig& config) const;
  // Corners that both track.
  [[nodiscard]] std::vector<LandmarkMatch> matches_of(const Keyframe& own,
                                                      const std::vector<PeerLandmark>& landmarks,
                                                      const std::vector<IndexPair>& pairs) const;
  // Landmarks that were found. What one is next to, of the own corners, is as far away.
  [[nodiscard]] std::vector<LandmarkMatch> aligned_of(const Keyframe& own,
                                                      const std::vector<PeerLandmark>& landmarks,
                                                      const std::vector<IndexPair>& pairs,
                                                      const std::vector<Search>& searches) const;

  KeyframeMatcherConfig config_;
  CameraIntrinsics camera_;
  Eigen::Vector3d p_start_ = Eigen::Vector3d::Zero();
  struct World {
    std::optional<Eigen::Isometry3d> known, supposed;  // T_own_drone
    std::uint64_t newest_keyframe = 0;                 // that was noted
  };
  std::map<std::string, World> worlds_;                        // by drone
  std::deque<std::pair<std::uint64_t, ImagePyramid>> images_;  // by keyframe, oldest first
};

}  // namespace covey
