// SPDX-License-Identifier: Apache-2.0
#include "apps/central_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <set>
#include <stdexcept>

#include "estimator/observation_model.h"
#include "estimator/so3.h"
#include "estimator/triangulation.h"

namespace covey {
namespace {

constexpr int kImu = State::kImuSize, kClone = 6, kPoint = 3;

int imu_offset(std::size_t drone) { return kImu * static_cast<int>(drone); }

void correct_pose(Pose& pose, const Eigen::Vector3d& dp, const Eigen::Vector3d& dtheta) {
  pose.p_world_imu += dp;
  pose.q_world_imu = (pose.q_world_imu * exp_quaternion(dtheta)).normalized();
}

}  // namespace

CentralFilter::CentralFilter(const CentralConfig& config, const std::vector<CentralStart>& drones)
    : config_(config) {
  const int size = kImu * static_cast<int>(drones.size());
  P_.setZero(size, size);
  for (std::size_t i = 0; i < drones.size(); ++i) {
    drones_.push_back({drones[i].extrinsics, {}, drones[i].imu, drones[i].imu, {}, {}});
    P_.block<kImu, kImu>(imu_offset(i), imu_offset(i)) = drones[i].covariance;
  }
}

void CentralFilter::add_imu(std::size_t drone, const ImuSample& sample) {
  drones_[drone].buffer.add(sample, config_.estimator.max_gyro, config_.estimator.max_accel);
}

void CentralFilter::add_images(const std::vector<Image>& images) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    propagate(i, images[i].camera.stamp_ns);
    clone(i, images[i].camera);
  }
  update_known(images);
  meet_new(images);
  forget_clones();
  forget_landmarks();
}

Odometry CentralFilter::odometry(std::size_t drone) const {
  const ImuState& imu = drones_[drone].imu;
  Odometry odometry{imu.stamp_ns,  FilterStatus::kTracking, imu.pose, imu.v_world_imu,
                    imu.gyro_bias, imu.accel_bias,          {}};
  const int p = imu_offset(drone) + State::kPosition, theta = imu_offset(drone) + State::kRotation;
  odometry.pose_covariance << P_.block<3, 3>(p, p), P_.block<3, 3>(p, theta),
      P_.block<3, 3>(theta, p), P_.block<3, 3>(theta, theta);
  return odometry;
}

void CentralFilter::propagate(std::size_t drone, TimeNs stamp_ns) {
  Drone& d = drones_[drone];
  const EstimatorConfig& config = config_.estimator;
  if (!d.buffer.covers(stamp_ns)) throw std::logic_error("central filter: image before its IMU");
  const ImuIncrement increment = integrate_imu(d.buffer.between(d.imu.stamp_ns, stamp_ns),
                                               d.imu.gyro_bias, d.imu.accel_bias, config.imu_noise);
  d.buffer.forget_before(stamp_ns);
  const Eigen::Vector3d g(0, 0, -config.gravity);
  const ImuState end = carried_over(d.imu, increment, stamp_ns, g);
  const Matrix15d F = transition(increment, d.first, end, g);
  const Matrix15d Q =
      process_noise(increment, d.imu.pose.q_world_imu.toRotationMatrix(), config.imu_noise);
  const int offset = imu_offset(drone);
  P_.middleRows<kImu>(offset) = (F * P_.middleRows<kImu>(offset)).eval();
  P_.middleCols<kImu>(offset) = (P_.middleCols<kImu>(offset) * F.transpose()).eval();
  P_.block<kImu, kImu>(offset, offset) += Q;
  d.imu = d.first = end;
}

void CentralFilter::clone(std::size_t drone, const CameraMeasurement& image) {
  Drone& d = drones_[drone];
  const TrackList tracks = sorted_by_id(image.tracks);
  const bool keyframe = becomes_keyframe(d, tracks);
  if (keyframe) d.reference = tracks;
  const int offset = static_cast<int>(P_.rows());
  grow(kClone);
  const int from = imu_offset(drone);
  P_.middleRows<3>(offset) = P_.middleRows<3>(from + State::kPosition);
  P_.middleRows<3>(offset + 3) = P_.middleRows<3>(from + State::kRotation);
  P_.middleCols<3>(offset) = P_.middleCols<3>(from + State::kPosition);
  P_.middleCols<3>(offset + 3) = P_.middleCols<3>(from + State::kRotation);
  d.clones.push_back({image.stamp_ns, keyframe, offset, d.imu.pose, d.first.pose, {}});
}

bool CentralFilter::becomes_keyframe(const Drone& drone, const TrackList& tracks) const {
  const auto last = std::find_if(drone.clones.rbegin(), drone.clones.rend(),
                                 [](const Clone& clone) { return clone.keyframe; });
  if (last == drone.clones.rend()) return true;
  const ViewChange change =
      compare_views(drone.reference, camera_pose(last->pose, drone.extrinsics), tracks,
                    camera_pose(drone.imu.pose, drone.extrinsics));
  return is_new_view(config_.estimator, change,
                     seconds_between(last->stamp_ns, drone.imu.stamp_ns));
}

std::optional<CentralFilter::Rows> CentralFilter::rows_of(const Drone& drone, const Clone& clone,
                                                          const Landmark& landmark,
                                                          const Bearing& bearing) {
  const auto now = observe_point(landmark.p_world, clone.pose, drone.extrinsics);
  const auto first = observe_point(landmark.first, clone.first, drone.extrinsics);
  if (!now.in_front || !first.in_front) return std::nullopt;
  const Eigen::Matrix2d& W = bearing.whitening;
  return Rows{clone.offset, landmark.offset, W * first.J_pose, W * first.J_point,
              W * (bearing.bearing - now.bearing)};
}

// Bearings of landmarks that are in the state count now, others wait at their clone.
void CentralFilter::update_known(const std::vector<Image>& images) {
  std::vector<Rows> all;
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    Clone& newest = drones_[i].clones.back();
    const CameraMeasurement& camera = images[i].camera;
    for (std::size_t k = 0; k < camera.tracks.size(); ++k) {
      const std::size_t id = images[i].landmarks[k];
      const Bearing bearing{camera.tracks[k].bearing, whitening(camera.tracks[k].covariance)};
      const auto known = index_of_.find(id);
      if (known == index_of_.end()) {
        newest.seen[id] = bearing;
        continue;
      }
      Landmark& landmark = landmarks_[known->second];
      landmark.seen_ns = camera.stamp_ns;
      if (const auto rows = rows_of(drones_[i], newest, landmark, bearing)) all.push_back(*rows);
    }
  }
  const auto count = 2 * static_cast<Eigen::Index>(all.size());
  if (count == 0) return;
  Eigen::MatrixXd PHt(P_.rows(), count);
  Eigen::MatrixXd S(count, count);
  Eigen::VectorXd r(count);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Rows& row = all[k];
    const auto at = 2 * static_cast<Eigen::Index>(k);
    PHt.middleCols<2>(at) = P_.middleCols<kClone>(row.clone_offset) * row.J_pose.transpose() +
                            P_.middleCols<kPoint>(row.landmark_offset) * row.J_point.transpose();
    r.segment<2>(at) = row.r;
  }
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Rows& row = all[k];
    S.middleRows<2>(2 * static_cast<Eigen::Index>(k)) =
        row.J_pose * PHt.middleRows<kClone>(row.clone_offset) +
        row.J_point * PHt.middleRows<kPoint>(row.landmark_offset);
  }
  S.diagonal().array() += 1;
  correct(PHt, S, r);
}

void CentralFilter::meet_new(const std::vector<Image>& images) {
  std::set<std::size_t> seen;
  for (const Image& image : images) seen.insert(image.landmarks.begin(), image.landmarks.end());
  for (const std::size_t id : seen) {
    if (index_of_.count(id) > 0 || !meet(id)) continue;
    for (Drone& drone : drones_) {
      for (Clone& clone : drone.clones) clone.seen.erase(id);
    }
  }
}

std::vector<CentralFilter::Sight> CentralFilter::sights_of(std::size_t id) const {
  std::vector<Sight> sights;
  for (const Drone& drone : drones_) {
    for (const Clone& clone : drone.clones) {
      const auto seen = clone.seen.find(id);
      if (seen != clone.seen.end()) sights.push_back({&drone, &clone, seen->second});
    }
  }
  return sights;
}

std::optional<CentralFilter::Landmark> CentralFilter::locate(
    std::size_t id, const std::vector<Sight>& sights) const {
  std::vector<View> views;
  TimeNs seen_ns = 0;
  for (const Sight& sight : sights) {
    views.push_back({camera_pose(sight.clone->pose, sight.drone->extrinsics), sight.bearing.bearing,
                     sight.bearing.whitening});
    seen_ns = std::max(seen_ns, sight.clone->stamp_ns);
  }
  const auto point = triangulate(views, {config_.estimator.min_depth, config_.estimator.max_depth});
  if (!point || point->relative_depth_error > config_.max_depth_error) return std::nullopt;
  return Landmark{id, static_cast<int>(P_.rows()), seen_ns, point->p_world, point->p_world};
}

// Delayed initialisation: of the bearings' rows, reflected so that three of them determine the
// landmark, the others are an update as that of an MSCKF feature.
bool CentralFilter::meet(std::size_t id) {
  const std::vector<Sight> sights = sights_of(id);
  if (sights.size() < config_.min_bearings) return false;
  std::optional<Landmark> landmark = locate(id, sights);
  if (!landmark) return false;
  const auto rows = 2 * static_cast<Eigen::Index>(sights.size());
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(rows, P_.rows());
  Eigen::MatrixXd H_point(rows, kPoint);
  Eigen::VectorXd r(rows);
  for (std::size_t k = 0; k < sights.size(); ++k) {
    const Sight& sight = sights[k];
    const auto row = rows_of(*sight.drone, *sight.clone, *landmark, sight.bearing);
    if (!row) return false;
    const auto at = 2 * static_cast<Eigen::Index>(k);
    H.block<2, kClone>(at, sight.clone->offset) = row->J_pose;
    H_point.middleRows<2>(at) = row->J_point;
    r.segment<2>(at) = row->r;
  }
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(H_point);
  H = qr.householderQ().transpose() * H;
  r = qr.householderQ().transpose() * r;
  const Eigen::Matrix3d R = qr.matrixQR().topRows<kPoint>().triangularView<Eigen::Upper>();
  join(*landmark, R.inverse(), H.topRows<kPoint>(), r.head<kPoint>());
  Eigen::MatrixXd rest = Eigen::MatrixXd::Zero(rows - kPoint, P_.rows());
  rest.leftCols(H.cols()) = H.bottomRows(rows - kPoint);
  update(rest, r.tail(rows - kPoint));
  return true;
}

// r = H dx + R dp + n with unit noise, for the landmark's error dp.
void CentralFilter::join(Landmark landmark, const Eigen::Matrix3d& R_inverse,
                         const Eigen::MatrixXd& H, const Eigen::Vector3d& r) {
  const Eigen::MatrixXd J = -R_inverse * H;
  const Eigen::MatrixXd cross = J * P_;
  const Eigen::Matrix3d own = cross * J.transpose() + R_inverse * R_inverse.transpose();
  grow(kPoint);
  P_.bottomLeftCorner(kPoint, landmark.offset) = cross;
  P_.topRightCorner(landmark.offset, kPoint) = cross.transpose();
  P_.bottomRightCorner<kPoint, kPoint>() = own;
  landmark.p_world += R_inverse * r;
  index_of_[landmark.id] = landmarks_.size();
  landmarks_.push_back(landmark);
}

void CentralFilter::forget_clones() {
  for (Drone& drone : drones_) {
    const auto leave = [&](std::size_t i) {
      remove(drone.clones[i].offset, kClone);
      drone.clones.erase(drone.clones.begin() + static_cast<std::ptrdiff_t>(i));
    };
    for (std::size_t i = drone.clones.size(); i-- > 0;) {
      const bool newest = i + 1 == drone.clones.size();
      if (!drone.clones[i].keyframe && !newest) leave(i);
    }
    while (static_cast<int>(drone.clones.size()) > config_.estimator.max_clones) leave(0);
  }
}

void CentralFilter::forget_landmarks() {
  while (landmarks_.size() > config_.max_landmarks) {
    const auto oldest = std::min_element(
        landmarks_.begin(), landmarks_.end(),
        [](const Landmark& a, const Landmark& b) { return a.seen_ns < b.seen_ns; });
    remove(oldest->offset, kPoint);
    landmarks_.erase(oldest);
  }
  index_of_.clear();
  for (std::size_t i = 0; i < landmarks_.size(); ++i) index_of_[landmarks_[i].id] = i;
}

void CentralFilter::update(const Eigen::MatrixXd& H, const Eigen::VectorXd& r) {
  const Eigen::MatrixXd PHt = P_ * H.transpose();
  Eigen::MatrixXd S = H * PHt;
  S.diagonal().array() += 1;
  correct(PHt, S, r);
}

void CentralFilter::correct(const Eigen::MatrixXd& PHt, const Eigen::MatrixXd& S,
                            const Eigen::VectorXd& r) {
  const Eigen::LLT<Eigen::MatrixXd> cholesky(S);
  if (cholesky.info() != Eigen::Success) {
    throw std::logic_error("central filter: innovation covariance not positive definite");
  }
  const Eigen::MatrixXd W = cholesky.matrixU().solve<Eigen::OnTheRight>(PHt);
  const Eigen::VectorXd dx = W * cholesky.matrixL().solve(r);
  P_.selfadjointView<Eigen::Lower>().rankUpdate(W, -1.0);
  for (Eigen::Index i = 1; i < P_.cols(); ++i) P_.col(i).head(i) = P_.row(i).head(i).transpose();
  apply(dx);
}

void CentralFilter::apply(const Eigen::VectorXd& dx) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    const auto d = dx.segment<kImu>(imu_offset(i));
    ImuState& imu = drones_[i].imu;
    correct_pose(imu.pose, d.segment<3>(State::kPosition), d.segment<3>(State::kRotation));
    imu.v_world_imu += d.segment<3>(State::kVelocity);
    imu.gyro_bias += d.segment<3>(State::kGyroBias);
    imu.accel_bias += d.segment<3>(State::kAccelBias);
    for (Clone& clone : drones_[i].clones) {
      correct_pose(clone.pose, dx.segment<3>(clone.offset), dx.segment<3>(clone.offset + 3));
    }
  }
  for (Landmark& landmark : landmarks_) landmark.p_world += dx.segment<3>(landmark.offset);
}

void CentralFilter::grow(int size) {
  const Eigen::Index old = P_.rows();
  P_.conservativeResize(old + size, old + size);
  P_.bottomRows(size).setZero();
  P_.rightCols(size).setZero();
}

void CentralFilter::remove(int offset, int size) {
  const Eigen::Index rest = P_.rows() - offset - size;
  P_.middleRows(offset, rest) = P_.bottomRows(rest).eval();
  P_.middleCols(offset, rest) = P_.rightCols(rest).eval();
  P_.conservativeResize(P_.rows() - size, P_.cols() - size);
  const auto move = [&](int& other) { other -= other > offset ? size : 0; };
  for (Drone& drone : drones_) {
    for (Clone& clone : drone.clones) move(clone.offset);
  }
  for (Landmark& landmark : landmarks_) move(landmark.offset);
}

}  // namespace covey
