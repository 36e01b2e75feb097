// SPDX-License-Identifier: Apache-2.0
#include "apps/pipeline.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "apps/camera_pose.h"
#include "apps/grey_image.h"
#include "apps/process_usage.h"
#include "apps/vocabulary_file.h"
#include "estimator/calibration_sigma.h"
#include "estimator/relative_pose.h"
#include "estimator/so3.h"

namespace covey {
namespace {

EstimatorConfig estimator_config(const AgentConfig& config, const SensorSetup& sensors) {
  EstimatorConfig estimator = config.estimator;
  estimator.imu_noise = sensors.imu_noise;
  estimator.extrinsics = sensors.extrinsics;
  estimator.slam_noise_scale = config.tracker.lasting_scale;
  if (!is_thermal_camera(config.thermal.mode, sensors.thermal)) return estimator;
  estimator.imu_noise_scale = config.thermal.imu_noise_scale;
  if (sensors.extrinsics.time_offset_s == 0) {
    estimator.extrinsics.time_offset_s = -config.thermal.time_constant_s;
  }
  return estimator;
}

TrackerConfig tracker_config(const AgentConfig& config, const SensorSetup& sensors) {
  TrackerConfig tracker = config.tracker;
  if (is_thermal_camera(config.thermal.mode, sensors.thermal)) {
    tracker.aligned_scale = config.thermal.aligned_scale;
  }
  tracker.alignment.compare_scales =
      is_calibrated(config.thermal.mode, sensors.thermal) && config.thermal.pixel_lag.sigma_s > 0;
  return tracker;
}

// Adds the time since its birth to one field.
class StageTimer {
 public:
  explicit StageTimer(double& ms) : ms_(ms), start_ms_(thread_cpu_ms()) {}
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;
  ~StageTimer() { ms_ += thread_cpu_ms() - start_ms_; }

 private:
  double& ms_;
  double start_ms_;
};

bool is_used(DriftOutcome outcome) {
  return outcome == DriftOutcome::kUsed || outcome == DriftOutcome::kMoved;
}

PeerOutcome to_peer_outcome(DriftOutcome outcome) {
  if (is_used(outcome)) return PeerOutcome::kFused;
  return outcome == DriftOutcome::kGated ? PeerOutcome::kGated : PeerOutcome::kRejected;
}

void take_over(const UpdateReport& update, TimingRecord& timing) {
  timing.propagate_ms = update.propagate_ms;
  timing.msckf_ms = update.msckf_ms;
  timing.slam_ms = update.slam_ms;
  timing.slam_features = update.slam_features;
  timing.clones = update.clones;
  timing.msckf_used = update.msckf_used;
  timing.msckf_gated = update.msckf_gated;
  timing.slam_used = update.slam_used;
  timing.slam_gated = update.slam_gated;
}

}  // namespace

Eigen::Quaterniond integrate_gyro(const std::vector<ImuSample>& imu, TimeNs from_ns, TimeNs to_ns,
                                  const Eigen::Vector3d& gyro_bias) {
  Eigen::Quaterniond q_from_to = Eigen::Quaterniond::Identity();
  for (std::size_t i = 0; i + 1 < imu.size(); ++i) {
    const TimeNs begin_ns = std::max(from_ns, imu[i].stamp_ns);
    const TimeNs end_ns = std::min(to_ns, imu[i + 1].stamp_ns);
    if (begin_ns >= end_ns) continue;
    const Eigen::Vector3d rate = (imu[i].gyro_imu + imu[i + 1].gyro_imu) / 2 - gyro_bias;
    q_from_to = q_from_to * exp_quaternion(rate * seconds_between(begin_ns, end_ns));
  }
  return q_from_to.normalized();
}

SensorSetup sensors_of(const Dataset& dataset) {
  return {dataset.camera,  dataset.extrinsics, dataset.imu_noise,
          dataset.thermal, dataset.mask,       dataset.line_delay_s};
}

Turn turn_at(const std::vector<ImuSample>& imu, TimeNs moment_ns,
             const Eigen::Vector3d& gyro_bias) {
  constexpr double kFitted_s = 0.022;
  double count = 0, t = 0, tt = 0;
  Eigen::Vector3d rate = Eigen::Vector3d::Zero(), rate_t = Eigen::Vector3d::Zero();
  for (const ImuSample& sample : imu) {
    const double time_s = seconds_between(moment_ns, sample.stamp_ns);
    if (time_s < -kFitted_s) continue;
    const Eigen::Vector3d turned = sample.gyro_imu - gyro_bias;
    count += 1;
    t += time_s;
    tt += time_s * time_s;
    rate += turned;
    rate_t += time_s * turned;
  }
  Turn turn;
  if (count == 0) return turn;
  if (count < 3) {
    turn.rate = rate / count;
    return turn;
  }
  const double determinant = count * tt - t * t;
  turn.rate = (tt * rate - t * rate_t) / determinant;
  turn.acceleration = (count * rate_t - t * rate) / determinant;
  return turn;
}

Pipeline::Pipeline(const AgentConfig& config, const SensorSetup& sensors,
                   std::optional<GroundTruth> truth)
    : config_(config),
      camera_(sensors.camera),
      line_delay_s_(sensors.line_delay_s),
      initialisation_(config.initialisation, config.estimator.gravity, std::move(truth)),
      lag_estimator_(config.thermal.pixel_lag),
      line_delay_check_(sensors.camera, sensors.line_delay_s),
      tracker_(tracker_config(config, sensors), sensors.camera, sensors.mask),
      estimator_(estimator_config(config, sensors), thread_cpu_ms),
      calibration_at_start_{camera_, estimator_.extrinsics(),
                            calibration_sigma_at_start(config.estimator)} {
  status_.agent = config.agent.name;
  if (is_calibrated(config.thermal.mode, sensors.thermal)) {
    calibration_.emplace(config.thermal.photometric,
                         cv::Size(sensors.camera.width, sensors.camera.height), sensors.mask);
    lags_ = config.thermal.pixel_lag.time_constant_s > 0;
  }
  if (lags_ || line_delay_s_ != 0) pixel_lag_.emplace(sensors.camera, line_delay_s_);
  if (config.agent.mode == FlightMode::kCollaborative) {
    collaborator_.emplace(collaborator_config(config, initialisation_.has_truth()),
                          vocabulary_of(config, sensors.thermal), sensors.camera);
    if (config.fusion.mode == FusionMode::kJoint) {
      drift_.emplace(drift_config(config.fusion, initialisation_.has_truth()), config.agent.name);
    }
  }
}

void Pipeline::add_imu(const ImuSample& sample) {
  if (estimator_.add_imu(sample)) recent_imu_.push_back(sample);
}

TimeNs Pipeline::imu_moment(TimeNs image_stamp_ns) const {
  return image_stamp_ns + nanoseconds(estimator_.extrinsics().time_offset_s);
}

ImageResult Pipeline::add_image(TimeNs stamp_ns, const cv::Mat& pixels) {
  ImageResult result;
  result.timing = std::exchange(peer_work_, TimingRecord{});
  result.timing.stamp_ns = stamp_ns;

  ++status_.frames;
  status_.stamp_ns = stamp_ns;
  if (collaborator_) collaborator_->set_time(stamp_ns);
  const Eigen::Quaterniond q_scene_now = turned_since_scene(stamp_ns);
  const Eigen::Matrix3d R_cam_previous = predicted_rotation(q_scene_now);
  const cv::Mat grey = prepared(stamp_ns, pixels, R_cam_previous, result);
  if (grey.empty()) {
    if (!started()) start_if_possible(stamp_ns);  // needs no image, only its moment
    result.update = estimator_.pass_image(stamp_ns);
    result.timing.propagate_ms = result.update.propagate_ms;
    if (started()) take_odometry(result);
    if (result.alone) result.odometry = with_team(*result.alone);
    remember_image(stamp_ns, q_scene_now);
    return result;
  }
  TrackedFrame frame = track(stamp_ns, grey, R_cam_previous, result);
  if (!started()) start_if_possible(stamp_ns);
  if (started()) {
    result.update = estimator_.add_camera(to_measurement(frame));
    take_over(result.update, result.timing);
    take_odometry(result);
  }
  if (result.alone) {
    frame.stamp_ns = result.alone->stamp_ns;  // of the pose it belongs to from here on
    check_rows(frame, result.timing);
    if (collaborator_) result.advert = keyframe(frame, result.timing);
    if (result.advert && config_.collaboration.exchange == ExchangeMode::kNaive) {
      result.advert.reset();
      if (auto newest = collaborator_->announcement()) {
        result.announcement = {*std::move(newest), estimator_.snapshot()};
      }
    }
    result.odometry = with_team(*result.alone);
  }
  result.frame = std::move(frame);
  remember_image(stamp_ns, Eigen::Quaterniond::Identity());
  return result;
}

cv::Mat Pipeline::prepared(TimeNs stamp_ns, const cv::Mat& pixels,
                           const Eigen::Matrix3d& R_cam_previous, ImageResult& result) {
  if (!calibration_ && !pixel_lag_) return to_grey8(pixels);
  const std::vector<TrackPlace> expected = tracker_.predict(stamp_ns, R_cam_previous);
  if (!calibration_) {
    const StageTimer timer(result.timing.track_ms);
    return without_lag(stamp_ns, to_grey8(pixels), expected);
  }
  const StageTimer timer(result.timing.thermal_ms);
  result.calibrated = calibration_->correct(stamp_ns, pixels, expected);
  result.content = result.calibrated->content;
  if (pixel_lag_ && result.content == ImageContent::kScene) {
    result.calibrated->pixels = without_lag(stamp_ns, result.calibrated->pixels, expected);
  }
  return result.calibrated->pixels;
}

Eigen::Vector3d Pipeline::mean_rate(TimeNs moment_ns, double over_s) const {
  const TimeNs from_ns = moment_ns - nanoseconds(over_s);
  return log_quaternion(integrate_gyro(recent_imu_, from_ns, moment_ns, gyro_bias())) / over_s;
}

cv::Mat Pipeline::without_lag(TimeNs stamp_ns, const cv::Mat& grey,
                              const std::vector<TrackPlace>& expected) {
  const TimeNs moment_ns = imu_moment(stamp_ns);
  const Turn turn_imu = line_delay_s_ != 0
                            ? turn_at(recent_imu_, moment_ns, gyro_bias())
                            : Turn{mean_rate(moment_ns, config_.thermal.pixel_lag.time_constant_s),
                                   Eigen::Vector3d::Zero()};
  const Eigen::Quaterniond q_cam_imu = estimator_.extrinsics().q_imu_cam.inverse();
  pixel_lag_->set_motion({q_cam_imu * turn_imu.rate, q_cam_imu * turn_imu.acceleration}, expected);
  return pixel_lag_->taken_out(grey, lags_ ? lag_estimator_.time_constant_s() : 0);
}

void Pipeline::check_rows(const TrackedFrame& frame, TimingRecord& timing) {
  if (status_.status != FilterStatus::kTracking) return;
  const StageTimer timer(timing.track_ms);
  const std::optional<CameraEstimate> camera = estimator_.camera();
  if (!camera) return;
  const bool due = line_delay_check_.is_due();
  line_delay_check_.add(frame, camera->T_world_cam,
                        due ? estimator_.depths() : std::vector<TrackDepth>());
}

void Pipeline::bring_to_the_stamp(TrackedFrame& frame) const {
  const std::vector<TrackPlace> places = tracker_.places();
  for (std::size_t i = 0; i < places.size(); ++i) {
    TrackedFeature& feature = frame.features[i];
    const auto bearing = unproject(camera_, feature.pixel - pixel_lag_->taken_too_far(places[i]));
    if (bearing) feature.bearing = *bearing;
  }
}

TrackedFrame Pipeline::track(TimeNs stamp_ns, const cv::Mat& grey,
                             const Eigen::Matrix3d& R_cam_previous, ImageResult& result) {
  TrackedFrame frame;
  {
    const StageTimer timer(result.timing.track_ms);
    frame = tracker_.track(stamp_ns, grey, R_cam_previous);
    if (line_delay_s_ != 0) bring_to_the_stamp(frame);
  }
  if (calibration_) {
    const StageTimer timer(result.timing.thermal_ms);
    const std::vector<TrackPlace> places = tracker_.places();
    calibration_->observe(places);
    if (lags_) lag_estimator_.learn(stamp_ns, places, *pixel_lag_);
  }
  result.timing.tracks = static_cast<std::int64_t>(frame.features.size());
  result.tracks_begun = frame.added;
  status_.tracks = static_cast<std::uint32_t>(frame.features.size());
  return frame;
}

// Where the IMU has not carried the filter to the image nobody knows where the drone is.
void Pipeline::take_odometry(ImageResult& result) {
  const Odometry alone = estimator_.odometry();
  status_.status = alone.status;
  if (result.update.propagated) result.alone = alone;
}

std::optional<Odometry> Pipeline::predicted(const std::vector<ImuSample>& samples) const {
  if (!started()) return std::nullopt;
  return with_team(estimator_.predicted(samples));
}

Odometry Pipeline::with_team(const Odometry& alone) const {
  return drift_ ? drift_->corrected(alone) : alone;
}

void Pipeline::start_if_possible(TimeNs stamp_ns) {
  const TimeNs moment_ns = imu_moment(stamp_ns);
  const TimeNs held_ns = nanoseconds(config_.estimator.max_imu_gap_s);
  if (recent_imu_.empty() || recent_imu_.front().stamp_ns > moment_ns + held_ns) {
    not_started_ = "its IMU has not begun by this image";
    return;
  }
  std::vector<ImuSample> until_image;
  for (const ImuSample& sample : recent_imu_) {
    if (sample.stamp_ns <= moment_ns) until_image.push_back(sample);
  }
  const auto start = initialisation_.start_at(moment_ns, until_image);
  if (const auto* not_yet = std::get_if<NotStill>(&start)) {
    not_started_ = not_yet->reason;
    return;
  }
  const auto& state = std::get<InitialState>(start);
  if (config_.initialisation.own_world) own_world_ = level_frame_at(state.pose);
  estimator_.initialize(seen_from(own_world_, state));
  start_ns_ = stamp_ns;
}

// Of an image without scene the turn is kept, and no samples: nobody knows how long that lasts.
void Pipeline::remember_image(TimeNs stamp_ns, const Eigen::Quaterniond& q_scene_image) {
  previous_image_ns_ = stamp_ns;
  q_scene_previous_ = q_scene_image.normalized();
  forget_old_imu(stamp_ns);
}

// Kept: what the next image's rotation needs, and before the start what the start needs.
void Pipeline::forget_old_imu(TimeNs stamp_ns) {
  const double history_s = started() ? 0.0 : 2 * initialisation_.history_s();
  const TimeNs oldest_ns = imu_moment(stamp_ns) - nanoseconds(history_s);
  std::size_t first = 0;
  while (first + 1 < recent_imu_.size() && recent_imu_[first + 1].stamp_ns <= oldest_ns) ++first;
  recent_imu_.erase(recent_imu_.begin(), recent_imu_.begin() + static_cast<std::ptrdiff_t>(first));
}

Eigen::Vector3d Pipeline::gyro_bias() const {
  return started() ? estimator_.odometry().gyro_bias : Eigen::Vector3d(Eigen::Vector3d::Zero());
}

Eigen::Quaterniond Pipeline::turned_since_scene(TimeNs stamp_ns) const {
  if (!previous_image_ns_) return Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond q_previous_now = integrate_gyro(
      recent_imu_, imu_moment(*previous_image_ns_), imu_moment(stamp_ns), gyro_bias());
  return q_scene_previous_ * q_previous_now;
}

Eigen::Matrix3d Pipeline::predicted_rotation(const Eigen::Quaterniond& q_scene_now) const {
  const Eigen::Quaterniond q_imu_cam = estimator_.extrinsics().q_imu_cam;
  return (q_imu_cam.conjugate() * q_scene_now.conjugate() * q_imu_cam).toRotationMatrix();
}

std::optional<PlaceAdvert> Pipeline::keyframe(TrackedFrame& frame, TimingRecord& timing) {
  if (status_.status != FilterStatus::kTracking) return std::nullopt;
  const std::optional<CameraEstimate> camera = estimator_.camera();
  if (!camera) return std::nullopt;
  const auto& [T_world_cam, covariance] = *camera;
  const ExchangeMode exchange = config_.collaboration.exchange;
  const bool wanted = collaborator_->wants_keyframe(frame.stamp_ns, T_world_cam);
  if (!wanted && exchange == ExchangeMode::kCompact) return collaborator_->repeated_question();
  {
    const StageTimer timer(timing.describe_ms);
    tracker_.describe(frame, T_world_cam.linear());
  }
  calibrate(frame);
  if (!wanted) {
    const StageTimer timer(timing.place_ms);
    return collaborator_->add_frame(frame, tracker_.image(), T_world_cam, covariance,
                                    estimator_.depths());
  }
  std::vector<KeyframeMatch> revisited;
  std::optional<PlaceAdvert> advert;
  {
    const StageTimer timer(timing.place_ms);
    advert = collaborator_->add_keyframe(frame, tracker_.image(), T_world_cam, covariance,
                                         estimator_.depths());
    if (drift_) drift_->add_own(collaborator_->database().last()->pose);
    if (drift_) revisited = collaborator_->revisit();
  }
  if (exchange == ExchangeMode::kPaper) keep_filter(advert->keyframe_id);
  if (collaborator_->wants_to_ask()) {
    advert = collaborator_->question(std::move(*advert));
  } else {
    advert.reset();
  }
  ++status_.keyframes;
  for (const KeyframeMatch& match : revisited) (void)fuse(match);
  return advert;
}

// What is kept and told of an image is right as far as the intrinsics are known by now.
void Pipeline::calibrate(TrackedFrame& frame) {
  const IntrinsicsError error = estimator_.intrinsics_error();
  collaborator_->set_intrinsics(corrected(camera_, error));
  for (TrackedFeature& feature : frame.features) feature.bearing -= feature.by_intrinsics * error;
}

// As long as the keyframe may be an answer.
void Pipeline::keep_filter(std::uint64_t keyframe_id) {
  filters_[keyframe_id] = estimator_.snapshot();
  for (auto kept = filters_.begin(); kept != filters_.end();) {
    const bool gone = collaborator_->database().find(kept->first) == nullptr;
    kept = gone ? filters_.erase(kept) : std::next(kept);
  }
}

std::optional<FullPeerKeyframe> Pipeline::with_filter(PeerKeyframe answer) const {
  const auto filter = filters_.find(answer.pose.keyframe_id);
  if (filter == filters_.end()) return std::nullopt;
  return FullPeerKeyframe{std::move(answer), filter->second};
}

std::optional<PeerKeyframe> Pipeline::answer(const PlaceAdvert& advert) {
  if (!collaborator_) return std::nullopt;
  // Where every image is told to all, nobody asks: it comes from a drone of another exchange.
  if (config_.collaboration.exchange == ExchangeMode::kNaive) {
    ++unexpected_questions_;
    return std::nullopt;
  }
  const StageTimer timer(peer_work_.place_ms);
  if (drift_ && collaborator_->has_started_anew(advert)) drift_->forget_drone(advert.sender);
  return collaborator_->answer(advert);
}

PeerResult Pipeline::fuse(const PeerKeyframe& message) {
  if (!collaborator_ || !started()) return {};
  if (message.found) return {learn(message), {}};
  std::variant<KeyframeMatch, NoMatch> matched;
  {
    const StageTimer timer(peer_work_.match_ms);
    matched = collaborator_->match(message);
  }
  const auto* match = std::get_if<KeyframeMatch>(&matched);
  return match != nullptr ? fuse(*match) : PeerResult{};
}

PeerResult Pipeline::fuse(const KeyframeMatch& match) {
  const StageTimer timer(peer_work_.peer_ms);
  if (drift_) {
    const auto relative = estimate_relative_pose(match, config_.collaboration.matching.min_matches);
    if (!relative) return {};
    const DriftOutcome outcome = fuse(*relative);
    PeerResult result{to_peer_outcome(outcome), {}};
    const bool agrees = is_used(outcome) || outcome == DriftOutcome::kUnaligned;
    const CollaboratorConfig& collaboration = config_.collaboration;
    if (agrees && collaboration.tell_found && collaboration.exchange == ExchangeMode::kCompact) {
      result.reply = as_told(*relative, config_.agent.name);
    }
    return result;
  }
  const PeerReport report = estimator_.add_peer(match);
  peer_landmarks_.used += report.used;
  peer_landmarks_.gated += report.gated;
  peer_landmarks_.unknown_track += report.unknown_track;
  peer_landmarks_.invalid += report.invalid;
  peer_landmarks_.uninformative += report.uninformative;
  if (report.used > 0) return {PeerOutcome::kFused, {}};
  return {report.gated > 0 ? PeerOutcome::kGated : PeerOutcome::kRejected, {}};
}

DriftOutcome Pipeline::fuse(const RelativePose& relative) {
  const DriftOutcome outcome = drift_->add(relative);
  if (is_used(outcome)) {
    tell_world_of(relative.drone);
    if (outcome == DriftOutcome::kMoved) collaborator_->place_anew(relative.drone);
    peer_landmarks_.used += relative.inliers;
  } else if (outcome == DriftOutcome::kUnaligned) {
    collaborator_->suppose_world(relative.drone, world_of(relative));
  } else if (outcome == DriftOutcome::kGated) {
    peer_landmarks_.gated += relative.inliers;
  }
  return outcome;
}

// What a peer has found of an own keyframe.
PeerOutcome Pipeline::learn(const PeerKeyframe& message) {
  const StageTimer timer(peer_work_.peer_ms);
  const Keyframe* own = collaborator_->hear_found(message);
  if (!drift_ || own == nullptr) return PeerOutcome::kRejected;
  return to_peer_outcome(fuse(found_by_peer(message, own->pose, own->before, own->mean_depth)));
}

// In the world as the own odometry alone has it, with all its drift: so keyframes stand in it.
void Pipeline::tell_world_of(const std::string& peer) {
  const std::optional<WorldAlignment> world = drift_->alignment(peer);
  if (!world) return;
  const Odometry alone = estimator_.odometry();
  const CameraExtrinsics extrinsics = estimator_.extrinsics();
  const Eigen::Isometry3d with_drift =
      camera_in_world(alone.pose, extrinsics) *
      camera_in_world(drift_->corrected(alone).pose, extrinsics).inverse();
  collaborator_->know_world(peer, with_drift * world->T_own_peer);
}

std::vector<TrackKind> Pipeline::kinds(const TrackedFrame& newest) {
  std::unordered_map<std::uint64_t, TrackKind> known;
  for (const TrackDepth& depth : estimator_.depths()) known[depth.track_id] = TrackKind::kMsckf;
  for (const std::uint64_t track : estimator_.slam_tracks()) known[track] = TrackKind::kSlam;
  std::vector<TrackKind> kinds;
  for (const TrackedFeature& feature : newest.features) {
    const auto found = known.find(feature.track_id);
    kinds.push_back(found == known.end() ? TrackKind::kOpportunistic : found->second);
  }
  return kinds;
}

AgentStatus Pipeline::status() const { return status_; }

FoundCalibration Pipeline::found_calibration() const {
  return {corrected(camera_, estimator_.intrinsics_error()), estimator_.extrinsics(),
          estimator_.calibration_sigma()};
}

std::optional<CollaboratorReport> Pipeline::collaboration() const {
  if (!collaborator_) return std::nullopt;
  return collaborator_->report();
}

void add_imu_for(TimeNs image_stamp_ns, const std::vector<ImuSample>& imu, std::size_t& next,
                 Pipeline& pipeline) {
  const TimeNs moment_ns = pipeline.imu_moment(image_stamp_ns);
  bool covered = next > 0 && imu[next - 1].stamp_ns > moment_ns;
  while (!covered && next < imu.size()) {
    const ImuSample& sample = imu[next++];
    pipeline.add_imu(sample);
    covered = sample.stamp_ns > moment_ns;
  }
}

}  // namespace covey
