// SPDX-License-Identifier: Apache-2.0
#include "estimator/estimator.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "estimator/filter_health.h"
#include "estimator/imu_buffer.h"
#include "estimator/imu_transition.h"
#include "estimator/keyframe_policy.h"
#include "estimator/landmark_depths.h"
#include "estimator/observation_model.h"
#include "estimator/peer_fusion.h"
#include "estimator/slam_update.h"
#include "estimator/state_readout.h"
#include "estimator/state_snapshot.h"
#include "estimator/track_selection.h"
#include "estimator/vision_start.h"
#include "estimator/vision_update.h"
#include "estimator/zero_velocity.h"

namespace covey {
namespace {

Eigen::Matrix<double, 15, 15> initial_covariance(const InitialState& start) {
  Eigen::Matrix<double, 15, 15> P = Eigen::Matrix<double, 15, 15>::Zero();
  const auto set = [&](int offset, double sigma) {
    P.diagonal().segment<3>(offset).setConstant(sigma * sigma);
  };
  set(State::kPosition, start.position_sigma);
  set(State::kVelocity, start.velocity_sigma);
  set(State::kGyroBias, start.gyro_bias_sigma);
  set(State::kAccelBias, start.accel_bias_sigma);
  // Yaw and tilt are meant in the world; the error is local: dtheta = R^T dtheta_world.
  const Eigen::Vector3d sigmas(start.tilt_sigma, start.tilt_sigma, start.yaw_sigma);
  const Eigen::Matrix3d R = start.pose.q_world_imu.toRotationMatrix();
  P.block<3, 3>(State::kRotation, State::kRotation) =
      R.transpose() * sigmas.cwiseAbs2().asDiagonal() * R;
  return P;
}

ImuState initial_imu(const InitialState& start) {
  return {start.stamp_ns, start.pose, start.v_world_imu, start.gyro_bias, start.accel_bias};
}

// Before the start: how far back it may lie, behind the newest IMU sample.
constexpr double kStartHistory_s = 10;
// Who waits longer for the first visual update makes it with whatever there is: the IMU alone
// forgets the scale that the initial velocity tells, and slow flight does not show it again.
constexpr double kStartPatience_s = 3;
// Landmarks and tracks wait for an image that shows anything: for no longer, because by then poses
// have become too uncertain for one linearisation.
constexpr double kLandmarksWait_s = 3;

// Of inverse depths, relative: from then on first estimates are kept.
constexpr double kDepthsKnown = 0.01;
// Of the visual scale, until it is made part of the state's again.
constexpr double kScaleDrift = 0.01;

EstimatorConfig with_noise_in_flight(EstimatorConfig config) {
  config.imu_noise.gyro_density *= config.imu_noise_scale;
  config.imu_noise.accel_density *= config.imu_noise_scale;
  config.imu_noise.max_gap_s = config.max_imu_gap_s;
  return config;
}

}  // namespace

struct Estimator::Impl {
  Impl(const EstimatorConfig& configuration, StageClock stage_clock)
      : config(with_noise_in_flight(configuration)), clock(stage_clock), gate_peer(0.95) {}

  double now_ms() const { return clock == nullptr ? 0.0 : clock(); }
  void start(const State& initial);
  std::optional<ImuInterval> propagate(TimeNs stamp_ns, UpdateReport& report);
  Eigen::Vector3d turn_rate(TimeNs stamp_ns) const;
  void stand_still(const ImuInterval& interval, UpdateReport& report);
  bool is_newest(TimeNs image_stamp_ns) const;
  bool becomes_keyframe(TimeNs image_stamp_ns, const TrackList& tracks) const;
  void try_start(UpdateReport& report);
  // What is told of the motion.
  const State& told() const { return glimpsed ? glimpsed->state : *state; }
  void update(const TrackList& tracks, UpdateReport& report);
  void drop_lost_landmarks(const TrackList& tracks);
  void settle_depths();
  void drop_clone(int index);
  void marginalize(std::optional<std::uint64_t> leaving);
  void refuse_image(TimeNs stamp_ns, UpdateReport& report);
  void apply(Remedy remedy, UpdateReport& report);
  void look_again();
  void end_waiting(TimeNs image_stamp_ns);
  void restart(UpdateReport& report);

  EstimatorConfig config;
  StageClock clock;
  PeerGate gate_peer;
  ImuBuffer imu;
  std::optional<State> state;
  // Before the first visual update: the state as the tracks so far have it, not to be kept.
  struct Glimpsed {
    State state;
    bool depths = false;  // with those of single tracks
  };
  std::optional<Glimpsed> glimpsed;
  std::optional<VisionStart> vision_start;
  std::optional<VisionUpdate> vision;
  std::optional<SlamUpdate> slam;
  std::optional<EkfUpdate> still_update;
  TrackStore store;
  StillnessDetector stillness;
  double usual_depth_m = 0;  // of what is seen, as it was known last; 0: never yet
  TrackList reference;       // of the last keyframe
  std::uint64_t reference_id = 0, next_clone_id = 1;
  bool seeing = false;          // the first visual update has been made
  TimeNs waiting_since_ns = 0;  // for it
  bool depths_known = false;    // since then
  FilterHealth health;
  UpdateReport pending;  // counts of IMU trouble until the next image
};

void Estimator::Impl::start(const State& initial) {
  state = initial;
  vision_start.emplace(config, state->capacity());
  vision.emplace(config, state->capacity());
  slam.emplace(config, state->capacity());
  still_update.emplace(16, state->capacity());
  glimpsed.reset();
  store.clear();
  stillness.clear();
  reference.clear();
  reference_id = 0;
  seeing = false;
  waiting_since_ns = state->imu().stamp_ns;
  health.begin(*state);
}

std::optional<ImuInterval> Estimator::Impl::propagate(TimeNs stamp_ns, UpdateReport& report) {
  const ImuState& now = state->imu();
  if (stamp_ns <= now.stamp_ns || !imu.covers(stamp_ns)) return std::nullopt;
  report.imu_gaps += imu.gaps_ending(now.stamp_ns, stamp_ns, config.max_imu_gap_s);
  ImuInterval interval = imu.between(now.stamp_ns, stamp_ns);
  const auto carry = [&](State& carried) {
    const ImuIncrement increment = integrate_imu(interval, carried.imu().gyro_bias,
                                                 carried.imu().accel_bias, config.imu_noise);
    carried.propagate(increment, stamp_ns, config.gravity, config.imu_noise);
  };
  carry(*state);
  if (glimpsed) carry(glimpsed->state);
  imu.forget_before(stamp_ns - nanoseconds(2 * config.still_window_s));
  return interval;
}

// rad/s, in imu; zero without any sample.
Eigen::Vector3d Estimator::Impl::turn_rate(TimeNs stamp_ns) const {
  const std::optional<ImuSample> moment = imu.at(stamp_ns);
  if (!moment) return Eigen::Vector3d::Zero();
  return moment->gyro_imu - state->imu().gyro_bias;
}

// If it does, as far as tracks and IMU show.
void Estimator::Impl::stand_still(const ImuInterval& interval, UpdateReport& report) {
  const std::optional<double> apparent_speed = stillness.speed_if_still(config);
  const TimeNs stamp_ns = state->imu().stamp_ns;
  if (!apparent_speed || !inertially_still(imu.last(stamp_ns, config.still_window_s), config,
                                           state->imu().gyro_bias)) {
    return;
  }
  const Stillness still{usual_depth_m == 0, usual_depth_m * *apparent_speed};
  report.zero_velocity =
      update_zero_velocity(*state, *still_update, interval.samples, still, config);
  if (!report.zero_velocity) return;
  if (glimpsed) {
    (void)update_zero_velocity(glimpsed->state, *still_update, interval.samples, still, config);
  }
}

// Of the images that have come so far, by their own clock.
bool Estimator::Impl::is_newest(TimeNs image_stamp_ns) const {
  return state->clones().empty() || image_stamp_ns > state->clones().back().stamp_ns;
}

bool Estimator::Impl::becomes_keyframe(TimeNs image_stamp_ns, const TrackList& tracks) const {
  const int last = state->find_clone(reference_id);
  if (last < 0) return true;
  const CameraPose reference_camera =
      camera_pose(state->clones()[static_cast<std::size_t>(last)].pose, state->extrinsics());
  const CameraPose present_camera = camera_pose(state->imu().pose, state->extrinsics());
  const ViewChange change = compare_views(reference, reference_camera, tracks, present_camera);
  const double age =
      seconds_between(state->clones()[static_cast<std::size_t>(last)].stamp_ns, image_stamp_ns);
  return is_new_view(config, change, age);
}

void Estimator::Impl::drop_lost_landmarks(const TrackList& tracks) {
  for (int i = static_cast<int>(state->landmarks().size()) - 1; i >= 0; --i) {
    const std::uint64_t id = state->landmarks()[static_cast<std::size_t>(i)].track_id;
    const auto place = std::lower_bound(tracks.begin(), tracks.end(), id,
                                        [](const TrackObservation& track, std::uint64_t wanted) {
                                          return track.track_id < wanted;
                                        });
    if (place != tracks.end() && place->track_id == id) continue;
    state->remove_landmark(i);
  }
}

// As long as depths are known badly, first estimates are wrong by as much, and linearised there
// parallax, known to a thousandth, would tell what it does not: gentle starts become overconfident.
// What first estimates are for, yaw and position that nothing shows, suffers little in the few
// seconds until then.
void Estimator::Impl::settle_depths() {
  if (state->common_depth_sigma() > kScaleDrift) state->separate_scale();
  if (depths_known) return;
  const std::optional<double> error = median_depth_error(*state);
  depths_known = config.max_slam_features == 0 || (error && *error < kDepthsKnown);
  if (!depths_known) state->forget_first_estimates();
}

void Estimator::Impl::drop_clone(int index) {
  reanchor(*state, index);
  store.forget_clone(state->clones()[static_cast<std::size_t>(index)].id);
  state->remove_clone(index);
  if (glimpsed) glimpsed->state.remove_clone(index);
}

void Estimator::Impl::marginalize(std::optional<std::uint64_t> leaving) {
  if (leaving) drop_clone(state->find_clone(*leaving));
  for (int i = static_cast<int>(state->clones().size()) - 2; i >= 0; --i) {
    if (!state->clones()[static_cast<std::size_t>(i)].keyframe) drop_clone(i);
  }
}

// Before the first visual update the window only collects; each new keyframe is a chance to start.
// What the tracks say until then is told, and carried on by the IMU where they do not agree, or
// where the drone stands still: who waits on the ground shall not work harder than who flies.
// Tracks that have ended are often short, their depths known badly and linearised where they are
// not: only who has waited long uses them.
void Estimator::Impl::try_start(UpdateReport& report) {
  const bool impatient =
      seconds_between(waiting_since_ns, state->imu().stamp_ns) > kStartPatience_s;
  std::vector<const Track*> tracks;
  for (const Track& track : store.tracks()) {
    const bool usable = track.seen_now || impatient;
    if (usable && track.observations.size() >= 2) tracks.push_back(&track);
  }
  tracks = longest_first(std::move(tracks));
  const bool keyframe = state->clones().back().keyframe;
  const bool attempt = keyframe && state->clones().size() >= 4;
  const auto glimpse = [&] {
    if (std::optional<State> seen = vision_start->glimpse(*state, tracks))
      glimpsed = {std::move(*seen), false};
  };
  const bool depths_seen = glimpsed && glimpsed->depths;
  const bool seen_enough = glimpsed && report.zero_velocity && !keyframe;
  if (!depths_seen && !seen_enough) glimpse();
  if (attempt) {
    State guess = told();
    const StartAttempt found = vision_start->start(*state, guess, tracks, impatient);
    seeing = found.outcome == StartAttempt::Outcome::kMade;
    report.msckf_used += found.tracks;
    if (found.outcome == StartAttempt::Outcome::kTooSoon) glimpsed = {std::move(guess), true};
    if (found.outcome == StartAttempt::Outcome::kNone && depths_seen) {
      glimpsed->depths = false;
      glimpse();
    }
  }
  if (!seeing) return;
  vision->add_slam_features(*state, tracks, report);
  depths_known = false;
  glimpsed.reset();
  store.forget_all_observations();
  for (const SlamLandmark& landmark : state->landmarks()) store.forget_track(landmark.track_id);
}

void Estimator::Impl::update(const TrackList& tracks, UpdateReport& report) {
  const std::uint64_t clone_id = state->clones().back().id;
  store.begin_image();
  for (const TrackObservation& track : tracks) {
    if (state->find_landmark(track.track_id) >= 0) continue;
    store.add(track.track_id,
              {clone_id, track.bearing, whitening(track.covariance), track.by_intrinsics});
  }
  if (!seeing) {
    const double start_ms = now_ms();
    try_start(report);
    if (seeing) {
      store.drop_ended();
    } else {
      store.drop_ended(kMinObservations);  // the others will help to start
    }
    marginalize(std::nullopt);
    if (static_cast<int>(state->clones().size()) > config.max_clones) {
      if (const auto view = dispensable_view(state->clones(), store)) drop_clone(*view);
    }
    report.msckf_ms = now_ms() - start_ms;
    return;
  }
  drop_lost_landmarks(tracks);
  const double slam_start = now_ms();
  slam->update(*state, tracks, report);
  const double msckf_start = now_ms();
  report.slam_ms = msckf_start - slam_start;

  int keyframes = 0;
  for (const Clone& clone : state->clones()) keyframes += clone.keyframe ? 1 : 0;
  std::optional<std::uint64_t> leaving;
  if (keyframes > config.max_clones) leaving = state->clones().front().id;

  const std::vector<const Track*> features =
      ended_or_leaving(store, leaving, config.max_msckf_features);
  const int free_slots = config.max_slam_features - static_cast<int>(state->landmarks().size());
  std::vector<const Track*> candidates;
  if (free_slots > 0) candidates = slam_candidates(store, *state, features);
  for (const std::uint64_t id :
       vision->update_tracks(*state, features, candidates, free_slots, report)) {
    if (state->find_landmark(id) >= 0) {
      store.forget_track(id);
    } else {
      store.forget_observations(id);
    }
  }
  settle_depths();
  store.drop_ended();
  marginalize(leaving);
  report.msckf_ms = now_ms() - msckf_start;
}

// Older than the state, or the IMU does not reach it: the state stays where it is, but without IMU
// that is not where the drone is.
void Estimator::Impl::refuse_image(TimeNs stamp_ns, UpdateReport& report) {
  ++report.images_refused;
  health.miss(stamp_ns);
}

void Estimator::Impl::apply(Remedy remedy, UpdateReport& report) {
  switch (remedy) {
    case Remedy::kNone:
      break;
    case Remedy::kLookAgain:
      look_again();
      break;
    case Remedy::kRestart:
      restart(report);
      break;
  }
}

// The next visual update is a batch again, from the present state and covariance.
void Estimator::Impl::look_again() {
  for (int i = static_cast<int>(state->landmarks().size()) - 1; i >= 0; --i)
    state->remove_landmark(i);
  state->merge_scale();
  seeing = false;
  waiting_since_ns = health.healthy_ns();
}

// What was seen too long ago is not waited for any more.
void Estimator::Impl::end_waiting(TimeNs image_stamp_ns) {
  if (state->clones().empty()) return;
  const double unseen_s = seconds_between(state->clones().back().stamp_ns, image_stamp_ns);
  if (unseen_s <= kLandmarksWait_s) return;
  look_again();
  store.forget_all_observations();
}

// Starts anew from the last healthy state and what the IMU has told since then, with the covariance
// that this has: what bearings have made of the state in between is not believed.
void Estimator::Impl::restart(UpdateReport& report) {
  start(State(config, health.fallback(config)));
  health.restarted();
  report.reinitialized = true;
}

Estimator::Estimator(const EstimatorConfig& config, StageClock clock)
    : impl_(std::make_unique<Impl>(config, clock)) {}
Estimator::~Estimator() = default;
Estimator::Estimator(Estimator&&) noexcept = default;
Estimator& Estimator::operator=(Estimator&&) noexcept = default;

void Estimator::initialize(const InitialState& start) {
  impl_->start(State(impl_->config, initial_imu(start), initial_covariance(start)));
  impl_->usual_depth_m = 0;
}

bool Estimator::initialized() const { return impl_->state.has_value(); }

bool Estimator::add_imu(const ImuSample& sample) {
  switch (impl_->imu.add(sample, impl_->config.max_gyro, impl_->config.max_accel)) {
    case ImuBuffer::Added::kYes:
      if (!initialized()) {
        impl_->imu.forget_before(sample.stamp_ns - nanoseconds(kStartHistory_s));
      }
      return true;
    case ImuBuffer::Added::kOutOfOrder:
      ++impl_->pending.out_of_order;
      break;
    case ImuBuffer::Added::kInvalid:
      ++impl_->pending.imu_rejected;
      break;
  }
  return false;
}

UpdateReport Estimator::add_camera(const CameraMeasurement& measurement) {
  Impl& self = *impl_;
  UpdateReport report = self.pending;
  self.pending = {};
  if (!self.state) return report;
  const double start = self.now_ms();
  const TimeNs stamp_ns =
      measurement.stamp_ns + nanoseconds(self.state->extrinsics().time_offset_s);
  if (!self.is_newest(measurement.stamp_ns)) {
    self.refuse_image(stamp_ns, report);
    return report;
  }
  const std::optional<ImuInterval> interval = self.propagate(stamp_ns, report);
  const bool at_start = stamp_ns == self.state->imu().stamp_ns && self.state->clones().empty();
  if (!interval && !at_start) {
    self.refuse_image(stamp_ns, report);
    return report;
  }
  report.propagated = true;
  self.end_waiting(measurement.stamp_ns);
  const TrackList tracks = sorted_by_id(measurement.tracks);
  self.stillness.add_image(stamp_ns, tracks, self.config);
  if (self.config.zero_velocity_updates && interval) self.stand_still(*interval, report);
  const bool keyframe = self.becomes_keyframe(measurement.stamp_ns, tracks);
  const Eigen::Vector3d rate = self.turn_rate(stamp_ns);
  const auto clone = [&](State& state) {
    state.add_clone(self.next_clone_id, measurement.stamp_ns, keyframe, rate);
  };
  clone(*self.state);
  if (self.glimpsed) clone(self.glimpsed->state);
  ++self.next_clone_id;
  if (keyframe) {
    self.reference = tracks;
    self.reference_id = self.state->clones().back().id;
  }
  report.propagate_ms = self.now_ms() - start;
  self.update(tracks, report);
  if (const double depth = median_depth(*self.state); depth > 0) self.usual_depth_m = depth;
  self.apply(
      self.health.watch(*self.state, report, tracks.size(), self.seeing, interval, self.config),
      report);
  report.clones = static_cast<int>(self.state->clones().size());
  report.slam_features = static_cast<int>(self.state->landmarks().size());
  return report;
}

UpdateReport Estimator::pass_image(TimeNs image_stamp_ns) {
  Impl& self = *impl_;
  UpdateReport report = self.pending;
  self.pending = {};
  if (!self.state) return report;
  const double start = self.now_ms();
  const TimeNs stamp_ns = image_stamp_ns + nanoseconds(self.state->extrinsics().time_offset_s);
  const std::optional<ImuInterval> interval = self.propagate(stamp_ns, report);
  report.propagated = interval.has_value();
  if (report.propagated) {
    self.health.pass(stamp_ns, *interval, self.config);
    self.end_waiting(image_stamp_ns);
  } else {
    self.refuse_image(stamp_ns, report);
  }
  report.clones = static_cast<int>(self.state->clones().size());
  report.slam_features = static_cast<int>(self.state->landmarks().size());
  report.propagate_ms = self.now_ms() - start;
  return report;
}

PeerReport Estimator::add_peer(const KeyframeMatch& match) {
  PeerReport report;
  if (!impl_->state || !impl_->seeing) {
    report.unknown_track = static_cast<int>(match.matches.size());
    return report;
  }
  return fuse_match({*impl_->state, impl_->store, *impl_->vision}, match, impl_->gate_peer,
                    impl_->config.max_msckf_features);
}

Odometry Estimator::odometry() const {
  Odometry odometry;
  if (impl_->state) odometry = odometry_of(impl_->told().core());
  odometry.status = impl_->health.status();
  return odometry;
}

Odometry Estimator::predicted(const std::vector<ImuSample>& samples) const {
  const EstimatorConfig& config = impl_->config;
  ImuBuffer buffer;
  for (const ImuSample& sample : samples)
    (void)buffer.add(sample, config.max_gyro, config.max_accel);
  if (!impl_->state || !buffer.covers(impl_->told().imu().stamp_ns + 1)) return odometry();
  const CoreState newest = impl_->told().core();
  Odometry odometry = odometry_of(dead_reckoned(newest, buffer.since(newest.imu.stamp_ns), config));
  odometry.status = impl_->health.status();
  return odometry;
}

FilterSnapshot Estimator::snapshot() const {
  return impl_->state ? snapshot_of(*impl_->state) : FilterSnapshot();
}

std::optional<CameraEstimate> Estimator::camera() const {
  if (!impl_->state || impl_->state->clones().empty()) return std::nullopt;
  return camera_of(impl_->told());
}

std::vector<TrackDepth> Estimator::depths() {
  std::vector<TrackDepth> depths;
  if (!impl_->state || !impl_->seeing) return depths;
  const State& state = *impl_->state;
  for (int i = 0; i < static_cast<int>(state.landmarks().size()); ++i) {
    const SlamLandmark& landmark = state.landmarks()[static_cast<std::size_t>(i)];
    const auto depth = depth_from(state, landmark, metric_depth_error(state, i));
    if (depth) depths.push_back(*depth);
  }
  for (const Track& track : impl_->store.tracks()) {
    if (!track.seen_now) continue;
    if (const auto depth = impl_->vision->depth_of(state, track)) depths.push_back(*depth);
  }
  return depths;
}

std::vector<std::uint64_t> Estimator::slam_tracks() const {
  std::vector<std::uint64_t> tracks;
  if (!impl_->state) return tracks;
  for (const SlamLandmark& landmark : impl_->state->landmarks()) {
    tracks.push_back(landmark.track_id);
  }
  return tracks;
}

CameraExtrinsics Estimator::extrinsics() const {
  return impl_->state ? impl_->state->extrinsics() : impl_->config.extrinsics;
}

CalibrationSigma Estimator::calibration_sigma() const {
  return impl_->state ? calibration_sigma_of(*impl_->state) : CalibrationSigma();
}

IntrinsicsError Estimator::intrinsics_error() const {
  return impl_->state ? impl_->state->intrinsics_error() : IntrinsicsError::Zero();
}

}  // namespace covey
