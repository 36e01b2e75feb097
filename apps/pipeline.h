// SPDX-License-Identifier: Apache-2.0
//
// One drone's stages, without threads, files or network: IMU samples, images and what peers sent
// go in; odometry and what is to be sent come out. Not thread-safe; same input, same output.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apps/config_file.h"
#include "apps/initialisation.h"
#include "apps/run_files.h"
#include "estimator/drift_filter.h"
#include "estimator/estimator.h"
#include "frontend/camera.h"
#include "frontend/collaborator.h"
#include "frontend/lag_estimator.h"
#include "frontend/line_delay_check.h"
#include "frontend/photometric_calibration.h"
#include "frontend/pixel_lag.h"
#include "frontend/tracker.h"

namespace covey {

// Rotation that takes vectors from the IMU at the later moment to the IMU at the earlier one:
// q_from_to. Samples outside the interval are left out.
[[nodiscard]] Eigen::Quaterniond integrate_gyro(const std::vector<ImuSample>& imu, TimeNs from_ns,
                                                TimeNs to_ns, const Eigen::Vector3d& gyro_bias);

// How the IMU turns, in imu: a line through the gyro's newest samples.
[[nodiscard]] Turn turn_at(const std::vector<ImuSample>& imu, TimeNs moment_ns,
                           const Eigen::Vector3d& gyro_bias);

struct SensorSetup {
  CameraIntrinsics camera;
  CameraExtrinsics extrinsics;
  ImuNoise imu_noise;
  bool thermal = false;     // Dataset::thermal; see is_thermal_camera
  cv::Mat mask{};           // Dataset::mask
  double line_delay_s = 0;  // CameraCalibration's
};

[[nodiscard]] SensorSetup sensors_of(const Dataset& dataset);

// The camera as it is believed to be, and how sure that is: zero where nothing is calibrated.
struct FoundCalibration {
  CameraIntrinsics camera;
  CameraExtrinsics extrinsics;
  CalibrationSigma sigma;
};

struct ImageResult {
  // Once started, when the IMU reaches the image; with what the team knows. At the instant of the
  // image on the IMU's clock.
  std::optional<Odometry> odometry;
  std::optional<Odometry> alone;      // the same without it
  std::optional<PlaceAdvert> advert;  // what to ask, when flying together: at keyframes, or always
  std::optional<FullPeerKeyframe> announcement;  // for all, in the naive exchange
  UpdateReport update;
  ImageContent content = ImageContent::kScene;  // otherwise only propagated
  std::optional<CalibratedImage> calibrated;    // of a thermal camera
  TrackedFrame frame;                           // without descriptors, except at keyframes
  std::int64_t tracks_begun = 0;
  TimingRecord timing;  // without what happens outside: reading, the total
};

// What the filter makes of a track of the newest image: it is in the state; its past tells where
// the point is, for an update when it ends; neither (paper, section III-A).
enum class TrackKind { kSlam, kMsckf, kOpportunistic };

enum class PeerOutcome { kFused, kGated, kRejected };

// What became of a peer's message, and what to tell that peer of it.
struct PeerResult {
  PeerOutcome outcome = PeerOutcome::kRejected;
  std::optional<PeerKeyframe> reply;
};

class Pipeline {
 public:
  // Throws std::runtime_error for a configuration that cannot work.
  Pipeline(const AgentConfig& config, const SensorSetup& sensors, std::optional<GroundTruth> truth);

  // In time order, for each image at least up to one sample past `imu_moment` of it.
  void add_imu(const ImuSample& sample);
  [[nodiscard]] TimeNs imu_moment(TimeNs image_stamp_ns) const;

  // `pixels`: CV_8UC1 or CV_16UC1.
  [[nodiscard]] ImageResult add_image(TimeNs stamp_ns, const cv::Mat& pixels);

  // The newest image's odometry, carried on by the IMU alone to the last of these samples, in time
  // order, from one before that image on. Nothing before the start.
  [[nodiscard]] std::optional<Odometry> predicted(const std::vector<ImuSample>& samples) const;

  // What peers send; only when flying together.
  [[nodiscard]] std::optional<PeerKeyframe> answer(const PlaceAdvert& advert);
  PeerResult fuse(const PeerKeyframe& message);
  // An answer of the paper's exchange. Nothing if the filter at its keyframe was not kept.
  [[nodiscard]] std::optional<FullPeerKeyframe> with_filter(PeerKeyframe answer) const;
  // Since the start, in the naive exchange, where nobody asks: not answered.
  [[nodiscard]] std::int64_t unexpected_questions() const { return unexpected_questions_; }

  [[nodiscard]] bool started() const { return start_ns_.has_value(); }
  [[nodiscard]] std::optional<TimeNs> start_ns() const { return start_ns_; }
  // Why not, at the newest image.
  [[nodiscard]] const std::string& not_started() const { return not_started_; }
  [[nodiscard]] AgentStatus status() const;
  // For people who look: the newest image as it was tracked, each track's kind, and what is known
  // of a thermal camera (null for others).
  [[nodiscard]] const cv::Mat& tracked_image() const { return tracker_.image().levels.front(); }
  [[nodiscard]] std::vector<TrackKind> kinds(const TrackedFrame& newest);
  [[nodiscard]] const PhotometricCalibration* calibration() const {
    return calibration_ ? &*calibration_ : nullptr;
  }
  // IMU samples that are kept for images to come.
  [[nodiscard]] std::size_t imu_samples_kept() const { return recent_imu_.size(); }
  // As it is estimated; nothing when it is not taken out of images.
  [[nodiscard]] std::optional<double> pixel_lag_s() const {
    return lags_ ? std::optional(lag_estimator_.time_constant_s()) : std::nullopt;
  }
  // LineDelayCheck::found_s
  [[nodiscard]] std::optional<double> line_delay_found_s() const {
    return line_delay_check_.found_s();
  }
  // As the flight has shown it by now, and as the dataset and the settings had it.
  [[nodiscard]] FoundCalibration found_calibration() const;
  [[nodiscard]] const FoundCalibration& calibration_at_start() const {
    return calibration_at_start_;
  }
  // Empty when flown alone.
  [[nodiscard]] std::optional<CollaboratorReport> collaboration() const;
  // Peers' landmarks since the start.
  [[nodiscard]] const PeerReport& peer_landmarks() const { return peer_landmarks_; }
  // The own world in the one of the ground truth, as it was at the start.
  [[nodiscard]] const Eigen::Isometry3d& own_world() const { return own_world_; }
  [[nodiscard]] const DriftFilter* team_knowledge() const { return drift_ ? &*drift_ : nullptr; }

 private:
  // What the tracker is to look at; empty when the image shows no scene.
  [[nodiscard]] cv::Mat prepared(TimeNs stamp_ns, const cv::Mat& pixels,
                                 const Eigen::Matrix3d& R_cam_previous, ImageResult& result);
  [[nodiscard]] TrackedFrame track(TimeNs stamp_ns, const cv::Mat& grey,
                                   const Eigen::Matrix3d& R_cam_previous, ImageResult& result);
  void take_odometry(ImageResult& result);
  [[nodiscard]] Odometry with_team(const Odometry& alone) const;
  void start_if_possible(TimeNs stamp_ns);
  void forget_old_imu(TimeNs stamp_ns);
  [[nodiscard]] Eigen::Vector3d gyro_bias() const;
  void remember_image(TimeNs stamp_ns, const Eigen::Quaterniond& q_scene_image);
  // Of the IMU, from the newest image with a scene to this one.
  [[nodiscard]] Eigen::Quaterniond turned_since_scene(TimeNs stamp_ns) const;
  [[nodiscard]] Eigen::Matrix3d predicted_rotation(const Eigen::Quaterniond& q_scene_now) const;
  [[nodiscard]] cv::Mat without_lag(TimeNs stamp_ns, const cv::Mat& grey,
                                    const std::vector<TrackPlace>& expected);
  // Of the IMU, rad/s, before a moment.
  [[nodiscard]] Eigen::Vector3d mean_rate(TimeNs moment_ns, double over_s) const;
  void check_rows(const TrackedFrame& frame, TimingRecord& timing);
  // Of a rolling shutter: tracks that move otherwise than the image around them was moved.
  void bring_to_the_stamp(TrackedFrame& frame) const;
  [[nodiscard]] std::optional<PlaceAdvert> keyframe(TrackedFrame& frame, TimingRecord& timing);
  void calibrate(TrackedFrame& frame);
  void keep_filter(std::uint64_t keyframe_id);
  PeerResult fuse(const KeyframeMatch& match);
  DriftOutcome fuse(const RelativePose& relative);
  PeerOutcome learn(const PeerKeyframe& message);
  void tell_world_of(const std::string& peer);

  AgentConfig config_;
  CameraIntrinsics camera_;  // as the dataset has it
  double line_delay_s_;      // likewise
  Initialisation initialisation_;
  std::optional<PhotometricCalibration> calibration_;  // of a thermal camera
  bool lags_ = false;                                  // its pixels do, and that is taken out
  LagEstimator lag_estimator_;
  LineDelayCheck line_delay_check_;
  std::optional<PixelLag> pixel_lag_;  // of pixels that lag, or rows that look one by one
  Tracker tracker_;
  Estimator estimator_;
  FoundCalibration calibration_at_start_;
  std::optional<Collaborator> collaborator_;
  std::optional<DriftFilter> drift_;                 // unless peers are fused in the estimator
  std::map<std::uint64_t, FilterSnapshot> filters_;  // at the keyframes, in the paper's exchange
  std::vector<ImuSample> recent_imu_;
  std::optional<TimeNs> previous_image_ns_, start_ns_;
  std::string not_started_ = "no image has come";
  // From the newest image with a scene to the previous image, which may have had none.
  Eigen::Quaterniond q_scene_previous_ = Eigen::Quaterniond::Identity();
  Eigen::Isometry3d own_world_ = Eigen::Isometry3d::Identity();
  TimingRecord peer_work_;  // since the last image
  PeerReport peer_landmarks_;
  std::int64_t unexpected_questions_ = 0;
  AgentStatus status_;
};

// Of a recording, from its sample `next`: those that the image of this stamp needs. `next` goes on.
void add_imu_for(TimeNs image_stamp_ns, const std::vector<ImuSample>& imu, std::size_t& next,
                 Pipeline& pipeline);

}  // namespace covey
