// SPDX-License-Identifier: Apache-2.0
//
// A drone's side of the exchange, without any network: which images become keyframes, what is
// asked, what is answered, and which of a peer's landmarks are points that this drone tracks as
// well.
//
//   collaborator.set_time(stamp);                                      // every image
//   if (collaborator.wants_keyframe(stamp, T_world_cam)) {
//     tracker.describe(frame);
//     advert = collaborator.add_keyframe(frame, image, pose, covariance, depths);
//     if (collaborator.wants_to_ask()) broadcast(collaborator.question(advert));
//     for (auto& match : collaborator.revisit()) ...                    // KeyframeMatch -> filter
//   }
//   on advert:   if (auto answer = collaborator.answer(advert)) send(*answer);
//   on keyframe: std::visit(..., collaborator.match(keyframe));         // KeyframeMatch -> filter
//   on keyframe.found: collaborator.hear_found(keyframe);               // which own one was found
//
// The exchanges of the paper ask or tell at the rate of the camera: there, images that are no
// keyframes go into add_frame().
//
// Everything that comes from a peer is checked here again: a peer may be hostile. Not thread-safe.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/answer_choice.h"
#include "frontend/answer_limiter.h"
#include "frontend/camera.h"
#include "frontend/collaborator_config.h"
#include "frontend/image_pyramid.h"
#include "frontend/keyframe_database.h"
#include "frontend/keyframe_matcher.h"
#include "frontend/peer_memory.h"
#include "frontend/place_recognition.h"
#include "frontend/question_policy.h"
#include "frontend/tracker.h"
#include "frontend/viewpoint_tolerance.h"

namespace covey {

// Counts since the start.
struct CollaboratorReport {
  int keyframes = 0;  // taken

  int adverts_received = 0;
  int answered = 0;
  int advert_own = 0;               // our own advert come back
  int advert_malformed = 0;         // no sender, no plausible view, or a descriptor of a wrong size
  int advert_other_vocabulary = 0;  // or another place mode
  int advert_unknown_asker = 0;     // a brief one of a drone of which is not known where it is
  int advert_unknown_place = 0;     // no keyframe scores enough
  int advert_too_soon = 0;          // rate limit

  int keyframes_received = 0;
  int matched = 0;                     // messages with matches
  int landmark_pairs = 0;              // in them
  int no_match[kNoMatchReasons] = {};  // by NoMatchReason
};

class Collaborator {
 public:
  // Throws std::runtime_error for a configuration that cannot work.
  Collaborator(const CollaboratorConfig& config, const Vocabulary& vocabulary,
               const CameraIntrinsics& camera);

  // As known by now: what is seen from here on is computed with them.
  void set_intrinsics(const CameraIntrinsics& camera);

  // Of the newest image, whatever it shows: answers are limited by it.
  void set_time(TimeNs stamp_ns) { now_ns_ = stamp_ns; }

  // PTAM rule.
  [[nodiscard]] bool wants_keyframe(TimeNs stamp_ns, const Eigen::Isometry3d& T_world_cam) const;

  // Features without descriptor are left out. `image`: as it was tracked; without levels no patches
  // are cut and none are looked for. `covariance`: of the pose, as in KeyframePose.
  PlaceAdvert add_keyframe(const TrackedFrame& described, const ImagePyramid& image,
                           const Eigen::Isometry3d& T_world_cam, const Matrix6d& covariance,
                           const std::vector<TrackDepth>& depths);

  // Whether the newest keyframe shall be asked about; if so it counts as asked. Not if the compact
  // exchange has asked from nearly there: the others are stored, so that there is a near one for
  // every question, and compared with what is known already.
  [[nodiscard]] bool wants_to_ask();

  // The newest keyframe's advert as it is sent: brief if corners have gone along lately and the
  // answers that came fitted.
  [[nodiscard]] PlaceAdvert question(PlaceAdvert advert);

  // Of the compact exchange, where nothing new is in view: the question or its answer may have been
  // lost, or who knows the place has come only now. By the newest keyframe, with its corners.
  [[nodiscard]] std::optional<PlaceAdvert> repeated_question();

  // An image between two keyframes, for exchanges at the rate of the camera. Answers find it among
  // the newest; nobody is answered with it.
  PlaceAdvert add_frame(const TrackedFrame& described, const ImagePyramid& image,
                        const Eigen::Isometry3d& T_world_cam, const Matrix6d& covariance,
                        const std::vector<TrackDepth>& depths);

  // The newest image as every drone is told it (receiver empty). Nothing if it shows too little.
  [[nodiscard]] std::optional<PeerKeyframe> announcement() const;

  // The newest keyframe against those that are here already, at no bytes: old ones of the own, and
  // what peers have answered before. Of each drone the one with the most similar view.
  [[nodiscard]] std::vector<KeyframeMatch> revisit();

  // Has who asks begun a new flight since it was answered or heard? What it told before holds no
  // more, and answer() forgets it.
  [[nodiscard]] bool has_started_anew(const PlaceAdvert& advert) const;

  // The stored keyframe that tells the asker most: choose_answer().
  [[nodiscard]] std::optional<PeerKeyframe> answer(const PlaceAdvert& advert);

  // The own keyframe that a peer tells to have found, if it was answered with that lately; else
  // null.
  [[nodiscard]] const Keyframe* hear_found(const PeerKeyframe& message);

  // Where a peer's world lies in the own one, as far as that is known by now: what it has seen is
  // looked for there first.
  void know_world(const std::string& peer, const Eigen::Isometry3d& T_own_peer);
  // What is remembered of a peer whose world was taken to lie elsewhere until now.
  void place_anew(const std::string& peer);
  // As one relative pose has it: looked for there too until it is known. Nothing else relies on it.
  void suppose_world(const std::string& peer, const Eigen::Isometry3d& T_own_peer);

  // Pairs of own track and peer landmark, one to one: of the image that was asked about, or of the
  // newest if the message is for all.
  [[nodiscard]] std::variant<KeyframeMatch, NoMatch> match(const PeerKeyframe& message);

  [[nodiscard]] const CollaboratorReport& report() const { return report_; }
  [[nodiscard]] const KeyframeDatabase& database() const { return database_; }
  [[nodiscard]] const ViewpointTolerance& tolerance() const { return tolerance_; }

 private:
  [[nodiscard]] Keyframe make_keyframe(const TrackedFrame& described, const ImagePyramid& image,
                                       const Eigen::Isometry3d& T_world_cam,
                                       const Matrix6d& covariance,
                                       const std::vector<TrackDepth>& depths);
  [[nodiscard]] PlaceAdvert advert_of(const Keyframe& keyframe) const;
  [[nodiscard]] const Keyframe* newest_image() const;
  [[nodiscard]] const Keyframe* find_image(std::uint64_t keyframe_id) const;
  [[nodiscard]] std::optional<CameraView> view_of_asker(const PlaceAdvert& advert) const;
  using Counter = int CollaboratorReport::*;
  // Of why nobody answers such an advert, or null.
  [[nodiscard]] Counter mistake_in(const PlaceAdvert& advert) const;
  // Of why it gets no answer now, or null. `asked_from`: view_of_asker().
  [[nodiscard]] Counter refusal(const PlaceAdvert& advert,
                                const std::optional<CameraView>& asked_from) const;
  [[nodiscard]] std::vector<const Keyframe*> not_just_sent_to(const std::string& peer) const;
  [[nodiscard]] std::variant<KeyframeMatch, NoMatch> find_matches(
      const PeerKeyframe& message) const;
  [[nodiscard]] std::variant<KeyframeMatch, NoMatch> compare(const Keyframe& own,
                                                             const PeerKeyframe& other) const;
  [[nodiscard]] std::vector<double> looked_for(const PeerKeyframe& other,
                                               const KeyframeMatch& match) const;
  [[nodiscard]] bool may_be_another_place(const PeerKeyframe& other,
                                          const KeyframeMatch& match) const;
  // A keyframe with all that is known of its landmarks.
  [[nodiscard]] PeerKeyframe as_seen(const Keyframe& keyframe,
                                     const std::vector<KeyframeFeature>& landmarks) const;
  // A keyframe as a peer is told it; the receiver and what it answers are left to fill in.
  [[nodiscard]] PeerKeyframe told(const Keyframe& keyframe,
                                  const std::vector<KeyframeFeature>& landmarks) const;
  [[nodiscard]] std::optional<KeyframeMatch> recognise(const Keyframe& newest,
                                                       const PeerKeyframe& old);
  void remember_for_later(const PeerKeyframe& message, NoMatchReason reason);
  void learn_tolerance(const PeerKeyframe& other, const KeyframeMatch& match);

  CollaboratorConfig config_;
  Vocabulary vocabulary_;
  std::uint64_t vocabulary_hash_;
  AnswerRules answer_rules_;
  CameraIntrinsics camera_;
  double patch_spacing_;  // between samples of a patch, normalised plane
  TimeNs now_ns_ = 0;     // stamp of the newest own image
  std::uint64_t next_keyframe_id_ = 1;
  KeyframeDatabase database_;
  std::deque<Keyframe> recent_frames_;  // no keyframes; oldest first
  PeerMemory peer_memory_;
  KeyframeMatcher matcher_;
  AnswerLimiter limiter_;
  QuestionPolicy questions_;
  ViewpointTolerance tolerance_;
  CollaboratorReport report_;
};

}  // namespace covey
