// SPDX-License-Identifier: Apache-2.0
#include "estimator/zero_velocity.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/chi_square.h"
#include "estimator/median.h"
#include "estimator/so3.h"

namespace covey {
namespace {

struct MeanReadings {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();
};

MeanReadings mean(std::vector<ImuSample>::const_iterator begin,
                  std::vector<ImuSample>::const_iterator end) {
  MeanReadings sum;
  for (auto sample = begin; sample != end; ++sample) {
    sum.gyro += sample->gyro_imu;
    sum.accel += sample->accel_imu;
  }
  const auto count = static_cast<double>(end - begin);
  return {sum.gyro / count, sum.accel / count};
}

// Rotation of the camera between two images, as if all tracks were far away: least squares over
// small angles, repeated without the tracks that do not fit.
Eigen::Matrix3d fitted_rotation(const TrackList& first, const TrackList& last) {
  constexpr double kOutlier = 0.02;  // normalised plane
  Eigen::Matrix3d R_first_last = Eigen::Matrix3d::Identity();
  for (int iteration = 0; iteration < 3; ++iteration) {
    Eigen::Matrix3d A = 1e-9 * Eigen::Matrix3d::Identity();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    auto old = first.begin();
    for (const TrackObservation& track : last) {
      while (old != first.end() && old->track_id < track.track_id) ++old;
      if (old == first.end() || old->track_id != track.track_id) continue;
      const Eigen::Vector3d turned = R_first_last * track.bearing.homogeneous();
      const Eigen::Vector2d seen = turned.head<2>() / turned.z();
      const Eigen::Vector2d error = old->bearing - seen;
      if (iteration > 0 && error.norm() > kOutlier) continue;
      Eigen::Matrix<double, 2, 3> J;  // d(seen)/d(dtheta), R <- Exp(dtheta) R
      J << -seen.x() * seen.y(), 1 + seen.x() * seen.x(), -seen.y(),  //
          -1 - seen.y() * seen.y(), seen.x() * seen.y(), seen.x();
      A += J.transpose() * J;
      b += J.transpose() * error;
    }
    R_first_last = exp_so3(A.ldlt().solve(b)) * R_first_last;
  }
  return R_first_last;
}

// Standard deviation of a bearing's component, of the track in the middle: one that is much surer
// or less sure than the others says nothing of the image.
double usual_sigma(const TrackList& tracks) {
  std::vector<double> sigmas;
  sigmas.reserve(tracks.size());
  for (const TrackObservation& track : tracks) {
    sigmas.push_back(std::sqrt(track.covariance.trace() / 2));
  }
  return median(std::move(sigmas));
}

constexpr std::size_t kMinSamples = 20;
constexpr std::size_t kMinShared = 15;
constexpr double kPast_s = 2, kPastEvery_s = 0.2;  // images of the past that are kept

ViewChange turned_views(const TrackList& first, const TrackList& last,
                        const Eigen::Matrix3d& R_first_last) {
  return compare_views(first, {Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero()}, last,
                       {R_first_last, Eigen::Vector3d::Zero()});
}

bool enough(const ViewChange& change, const TrackList& last) {
  return change.shared * static_cast<double>(last.size()) >= kMinShared;
}

// By how much noise alone moves a track: about 1.18 sqrt(2) sigma (median of a Rayleigh
// distribution).
double motion_by_noise(const TrackList& tracks) { return 1.67 * usual_sigma(tracks); }

// Rows of which the state knows more than they say. `unseen`: of the velocity's, in their sigmas.
void leave_out_known(const State& state, double unseen, StillRows& rows) {
  const Eigen::Matrix<double, State::kImuSize, State::kImuSize> P =
      state.covariance().topLeftCorner<State::kImuSize, State::kImuSize>();
  const auto leave_out = [&](int first, double sigma) {
    const auto H = rows.H.middleRows<3>(first);
    if ((H * P * H.transpose()).trace() > 3 * sigma * sigma) return;
    rows.H.middleRows<3>(first).setZero();
    rows.r.segment<3>(first).setZero();
  };
  leave_out(0, unseen);
  leave_out(3, 1);
  leave_out(6, 1);
}

}  // namespace

bool inertially_still(const std::vector<ImuSample>& window, const EstimatorConfig& config,
                      const Eigen::Vector3d& gyro_bias) {
  if (window.size() < kMinSamples) return false;
  if (seconds_between(window.front().stamp_ns, window.back().stamp_ns) <
      0.9 * config.still_window_s) {
    return false;
  }
  const auto middle = window.begin() + static_cast<std::ptrdiff_t>(window.size() / 2);
  const MeanReadings early = mean(window.begin(), middle);
  const MeanReadings late = mean(middle, window.end());
  return (late.gyro - early.gyro).norm() < config.still_gyro &&
         (late.accel - early.accel).norm() < config.still_accel &&
         (late.gyro - gyro_bias).norm() < 5 * config.still_gyro;
}

void StillnessDetector::add_image(TimeNs stamp_ns, const TrackList& tracks,
                                  const EstimatorConfig& config) {
  if (past_.empty() || seconds_between(past_.back().stamp_ns, stamp_ns) >= kPastEvery_s) {
    past_.push_back({stamp_ns, tracks});
  }
  while (seconds_between(past_.front().stamp_ns, stamp_ns) > kPast_s) past_.pop_front();
  window_.push_back({stamp_ns, tracks});
  while (window_.size() > 1 &&
         seconds_between(window_[1].stamp_ns, stamp_ns) >= config.still_window_s) {
    window_.pop_front();
  }
}

std::optional<double> StillnessDetector::speed_if_still(const EstimatorConfig& config) const {
  if (window_.size() < 2 || window_.back().tracks.empty()) return std::nullopt;
  const Image& first = window_.front();
  const Image& last = window_.back();
  if (seconds_between(first.stamp_ns, last.stamp_ns) < config.still_window_s) return std::nullopt;
  const Eigen::Matrix3d R_first_last = fitted_rotation(first.tracks, last.tracks);
  const ViewChange change = turned_views(first.tracks, last.tracks, R_first_last);
  const double noise = motion_by_noise(last.tracks);
  if (!enough(change, last.tracks)) return std::nullopt;
  if (!(change.parallax < std::hypot(config.still_parallax, noise))) return std::nullopt;
  const double motion = motion_seen();
  if (!(motion < std::hypot(config.still_drift, noise))) return std::nullopt;
  const TimeNs since_ns = std::min(past_.front().stamp_ns, first.stamp_ns);
  return motion / seconds_between(since_ns, last.stamp_ns);
}

double StillnessDetector::motion_seen() const {
  const TrackList& last = window_.back().tracks;
  double most = 0;
  for (const Image& image : past_) {
    const ViewChange change = turned_views(image.tracks, last, Eigen::Matrix3d::Identity());
    if (enough(change, last)) most = std::max(most, change.parallax);
  }
  return most;
}

StillRows still_rows(const ImuState& imu, const std::vector<ImuSample>& interval,
                     double velocity_sigma, const EstimatorConfig& config) {
  const MeanReadings readings = mean(interval.begin(), interval.end());
  const Eigen::Vector3d up_imu =
      imu.pose.q_world_imu.conjugate() * Eigen::Vector3d(0, 0, config.gravity);
  StillRows rows;
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  rows.H.block<3, 3>(0, State::kVelocity) = I / velocity_sigma;
  rows.r.head<3>() = -imu.v_world_imu / velocity_sigma;
  rows.H.block<3, 3>(3, State::kGyroBias) = I / config.still_gyro_sigma;
  rows.r.segment<3>(3) = (readings.gyro - imu.gyro_bias) / config.still_gyro_sigma;
  rows.H.block<3, 3>(6, State::kRotation) = skew(up_imu) / config.still_accel_sigma;
  rows.H.block<3, 3>(6, State::kAccelBias) = I / config.still_accel_sigma;
  rows.r.tail<3>() = (readings.accel - imu.accel_bias - up_imu) / config.still_accel_sigma;
  return rows;
}

bool update_zero_velocity(State& state, EkfUpdate& update, const std::vector<ImuSample>& interval,
                          const Stillness& still, const EstimatorConfig& config) {
  const double velocity_sigma = std::hypot(config.still_velocity_sigma, still.unseen_speed);
  StillRows rows = still_rows(state.imu(), interval, velocity_sigma, config);
  Columns columns;
  columns.add(0, State::kImuSize);
  update.begin(state);
  update.add(state, rows.H, rows.r, columns);
  if (!(update.last_distance() <= chi_square_quantile(0.999, 9))) return false;
  if (!still.stands) {
    leave_out_known(state, still.unseen_speed / velocity_sigma, rows);
    update.begin(state);
    update.add(state, rows.H, rows.r, columns);
  }
  return update.apply(state);
}

}  // namespace covey
