// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/chi_square.h"
#include "estimator/so3.h"

namespace covey {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kSize = 6;                // of one keyframe's error
constexpr double kMinVariance = 1e-10;  // m2 or rad2, of a step along a chain
// Relative poses of one drone: what is here already, and its answer.
constexpr int kMostPerKeyframe = 2;
constexpr double kMaxTilt = 0.05;  // rad, between two worlds whose gravity is one
// How uncertain a world is taken to be that a few relative poses have aligned.
constexpr double kAlignedSigma_m = 1.0, kAlignedSigma_rad = 0.1;

constexpr auto block(int node) { return kSize * node; }

// How the error at `from` shows at `to`, on the way of one drone.
Matrix6d lever(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  Matrix6d F = Matrix6d::Identity();
  F.block<3, 1>(0, 5) = Eigen::Vector3d::UnitZ().cross(to - from);
  return F;
}

// One step along a drone's way: e_to = A e_from + w.
struct Step {
  Matrix6d A = Matrix6d::Zero();
  Matrix6d Q = Matrix6d::Identity();  // cov(w)
};

// Odometry says how uncertain it was at both ends, not how the two errors hang together. Where it
// has become less certain (position, yaw), the old error has stayed and something was added:
// cov(to, from) = P_from. Where it has become more certain (tilt), the new error is what is left of
// the old one: cov(to, from) = P_to. With V V^T = F P_from F^T and V L V^T = P_to both are
// V min(1, L) V^T.
Step step_between(const Eigen::Vector3d& from, const Matrix6d& P_from, const Eigen::Vector3d& to,
                  const Matrix6d& P_to) {
  const Matrix6d F = lever(from, to);
  const Eigen::LLT<Matrix6d> cholesky(F * P_from * F.transpose());
  const auto L = cholesky.matrixL();
  const Matrix6d M = L.solve(L.solve(P_to).transpose());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen((M + M.transpose()) / 2);
  const Vector6d kept = eigen.eigenvalues().cwiseMax(0.0).cwiseMin(1.0);
  const Vector6d added = eigen.eigenvalues().cwiseMax(0.0) - kept.cwiseAbs2();
  const Matrix6d V = L * eigen.eigenvectors();
  const Matrix6d V_inverse = eigen.eigenvectors().transpose() * L.solve(Matrix6d::Identity());
  Step step{V * kept.asDiagonal() * V_inverse * F, V * added.asDiagonal() * V.transpose()};
  step.Q.diagonal().array() += kMinVariance;
  return step;
}

Matrix6d rotated(const Matrix6d& covariance, const Eigen::Matrix3d& R) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = R;
  turn.bottomRightCorner<3, 3>() = R;
  return turn * covariance * turn.transpose();
}

// The peer's world in the own one as one relative pose has it, own drift not taken out.
Eigen::Isometry3d world_of(const RelativePose& measurement) {
  return measurement.own.T_world_cam * measurement.T_other_own.inverse() *
         measurement.other.T_world_cam.inverse();
}

double yaw_of(const Eigen::Matrix3d& R) { return std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1)); }

double tilt_of(const Eigen::Matrix3d& R) { return std::acos(std::clamp(R(2, 2), -1.0, 1.0)); }

double wrapped(double angle) { return std::remainder(angle, 2 * M_PI); }

}  // namespace

DriftFilter::DriftFilter(const DriftConfig& config, std::string own_name)
    : config_(config), gate_limit_(chi_square_quantile(config.gate_confidence, kSize)) {
  drones_.push_back({std::move(own_name), {}, {}, {}});
  drones_.front().world.known = true;
}

int DriftFilter::drone_index(const std::string& name) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    if (drones_[i].name == name) return static_cast<int>(i);
  }
  drones_.push_back({name, {}, {}, {}});
  drones_.back().world.known = config_.common_start;
  return static_cast<int>(drones_.size()) - 1;
}

void DriftFilter::add_own(const KeyframePose& pose) {
  own_history_.push_back(
      {pose.stamp_ns, pose.covariance.topLeftCorner<3, 3>().trace(), pose.covariance(5, 5)});
}

// At least a share of what the own odometry had drifted by then: who claims less is not believed.
Matrix6d DriftFilter::believable(const KeyframePose& peer) const {
  const auto after =
      std::find_if(own_history_.begin(), own_history_.end(),
                   [&](const OwnDrift& own) { return own.stamp_ns > peer.stamp_ns; });
  if (after == own_history_.begin()) return peer.covariance;
  const OwnDrift& own = *std::prev(after);
  const double position = peer.covariance.topLeftCorner<3, 3>().trace();
  const double yaw = peer.covariance(5, 5);
  const double factor = config_.least_claim * std::max(own.position / position, own.yaw / yaw);
  return std::max(1.0, factor) * peer.covariance;
}

DriftFilter::Node DriftFilter::to_node(int drone, const KeyframePose& pose) const {
  const World& world = drones_[static_cast<std::size_t>(drone)].world;
  const Eigen::Isometry3d T_world_cam = world.T_own_peer * pose.T_world_cam;
  Node node{drone,
            pose.keyframe_id,
            pose.stamp_ns,
            T_world_cam.translation(),
            T_world_cam.linear(),
            rotated(drone == 0 ? pose.covariance : believable(pose), world.T_own_peer.linear())};
  const Matrix6d F = lever(world.pivot, node.p);
  node.covariance += F * world.covariance * F.transpose();
  return node;
}

int DriftFilter::neighbour(const Node& node, bool earlier) const {
  int best = -1;
  for (int i = 0; i < keyframes(); ++i) {
    const Node& other = nodes_[static_cast<std::size_t>(i)];
    if (other.drone != node.drone || (other.stamp_ns < node.stamp_ns) != earlier) continue;
    const auto& stamp = [&](int index) { return nodes_[static_cast<std::size_t>(index)].stamp_ns; };
    if (best < 0 || (earlier ? stamp(i) > stamp(best) : stamp(i) < stamp(best))) best = i;
  }
  return best;
}

int DriftFilter::find_or_insert(const Node& node) {
  for (int i = 0; i < keyframes(); ++i) {
    const Node& known = nodes_[static_cast<std::size_t>(i)];
    if (known.drone == node.drone && known.keyframe_id == node.keyframe_id) return i;
  }
  const int earlier = neighbour(node, true), later = neighbour(node, false);
  // What the earlier one says of it, or only the odometry; then what the later one adds.
  Step from_earlier{Matrix6d::Zero(), node.covariance};
  if (earlier >= 0)
    from_earlier =
        step_between(nodes_[static_cast<std::size_t>(earlier)].p,
                     nodes_[static_cast<std::size_t>(earlier)].covariance, node.p, node.covariance);
  Matrix6d from_later = Matrix6d::Zero();
  if (later >= 0) {
    const Step onward =
        step_between(node.p, node.covariance, nodes_[static_cast<std::size_t>(later)].p,
                     nodes_[static_cast<std::size_t>(later)].covariance);
    const Matrix6d Q = from_earlier.Q;
    const Matrix6d S = onward.A * Q * onward.A.transpose() + onward.Q;
    from_later = S.llt().solve(onward.A * Q).transpose();
    const Matrix6d rest = Matrix6d::Identity() - from_later * onward.A;
    from_earlier.A = rest * from_earlier.A;
    from_earlier.Q = rest * Q * rest.transpose() + from_later * onward.Q * from_later.transpose();
  }
  append(node, earlier, from_earlier.A, later, from_later, from_earlier.Q);
  return keyframes() - 1;
}

void DriftFilter::append(const Node& node, int earlier, const Matrix6d& from_earlier, int later,
                         const Matrix6d& from_later, const Matrix6d& noise) {
  const int n = kSize * keyframes();
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(kSize, n);
  Vector6d mean = Vector6d::Zero();
  if (earlier >= 0) {
    cross += from_earlier * P_.block(block(earlier), 0, kSize, n);
    mean += from_earlier * x_.segment<kSize>(block(earlier));
  }
  if (later >= 0) {
    cross += from_later * P_.block(block(later), 0, kSize, n);
    mean += from_later * x_.segment<kSize>(block(later));
  }
  Matrix6d own = noise;
  if (earlier >= 0) own += cross.middleCols<kSize>(block(earlier)) * from_earlier.transpose();
  if (later >= 0) own += cross.middleCols<kSize>(block(later)) * from_later.transpose();
  x_.conservativeResize(n + kSize);
  P_.conservativeResize(n + kSize, n + kSize);
  x_.tail<kSize>() = mean;
  P_.bottomLeftCorner(kSize, n) = cross;
  P_.topRightCorner(n, kSize) = cross.transpose();
  P_.bottomRightCorner<kSize, kSize>() = (own + own.transpose()) / 2;
  nodes_.push_back(node);
}

// Forgets the keyframe whose neighbours on its drone's way are closest in time; of each drone the
// first and the last stay.
void DriftFilter::make_room() {
  while (keyframes() + 2 > config_.max_keyframes) {
    int closest = -1;
    TimeNs shortest = 0;
    for (int i = 0; i < keyframes(); ++i) {
      const Node& node = nodes_[static_cast<std::size_t>(i)];
      const int before = neighbour(node, true);
      int after = -1;
      for (int j = 0; j < keyframes(); ++j) {
        const Node& other = nodes_[static_cast<std::size_t>(j)];
        if (other.drone != node.drone || other.stamp_ns <= node.stamp_ns) continue;
        if (after < 0 || other.stamp_ns < nodes_[static_cast<std::size_t>(after)].stamp_ns)
          after = j;
      }
      if (before < 0 || after < 0) continue;
      const TimeNs span = nodes_[static_cast<std::size_t>(after)].stamp_ns -
                          nodes_[static_cast<std::size_t>(before)].stamp_ns;
      if (closest < 0 || span < shortest) {
        closest = i;
        shortest = span;
      }
    }
    if (closest < 0) closest = 0;
    forget(closest);
  }
}

// The last one takes its place.
void DriftFilter::forget(int index) {
  const int last = keyframes() - 1, n = block(last);
  if (index != last) {
    nodes_[static_cast<std::size_t>(index)] = nodes_.back();
    x_.segment<kSize>(block(index)) = x_.tail<kSize>();
    P_.middleCols<kSize>(block(index)) = P_.rightCols<kSize>().eval();
    P_.middleRows<kSize>(block(index)) = P_.bottomRows<kSize>().eval();
    P_.block<kSize, kSize>(block(index), block(index)) =
        P_.bottomRightCorner<kSize, kSize>().eval();
  }
  nodes_.pop_back();
  x_.conservativeResize(n);
  P_.conservativeResize(n, n);
}

DriftOutcome DriftFilter::add(const RelativePose& measurement) {
  if (Eigen::LLT<Matrix6d>(measurement.covariance).info() != Eigen::Success ||
      Eigen::LLT<Matrix6d>(measurement.other.covariance).info() != Eigen::Success) {
    return DriftOutcome::kInvalid;
  }
  const int index = drone_index(measurement.drone);
  if (drones_[static_cast<std::size_t>(index)].world.known) return use(index, measurement);
  if (!align(drones_[static_cast<std::size_t>(index)].world, measurement)) {
    return DriftOutcome::kUnaligned;
  }
  const std::vector<RelativePose> agreeing =
      std::exchange(drones_[static_cast<std::size_t>(index)].world.candidates, {});
  DriftOutcome outcome = DriftOutcome::kGated;
  for (const RelativePose& candidate : agreeing) outcome = use(index, candidate);
  return outcome;
}

// Believed once several relative poses, from different keyframes on both sides, agree and most of
// what was seen agrees with them: one false match, or a scene that repeats itself, is not enough.
bool DriftFilter::align(World& world, const RelativePose& measurement) {
  const Eigen::Isometry3d newest = world_of(measurement);
  if (tilt_of(newest.linear()) > kMaxTilt) return false;
  world.candidates.push_back(measurement);
  const auto agrees = [&](const RelativePose& other) {
    const Eigen::Isometry3d T = world_of(other);
    const Eigen::Vector3d p = measurement.other.T_world_cam.translation();
    return (T * p - newest * p).norm() < config_.alignment_agree_m &&
           std::abs(wrapped(yaw_of(T.linear()) - yaw_of(newest.linear()))) <
               config_.alignment_agree_rad;
  };
  std::vector<RelativePose> agreeing;
  for (const RelativePose& candidate : world.candidates) {
    const bool repeats =
        std::any_of(agreeing.begin(), agreeing.end(), [&](const RelativePose& other) {
          return other.own.keyframe_id == candidate.own.keyframe_id ||
                 other.other.keyframe_id == candidate.other.keyframe_id;
        });
    if (agrees(candidate) && !repeats) agreeing.push_back(candidate);
  }
  constexpr double kMost = 0.6;
  constexpr std::size_t kMaxCandidates = 30;
  const auto all_agreeing = std::count_if(world.candidates.begin(), world.candidates.end(), agrees);
  const bool believed =
      static_cast<int>(agreeing.size()) >= config_.alignment_votes &&
      static_cast<double>(all_agreeing) >= kMost * static_cast<double>(world.candidates.size());
  if (!believed) {
    if (world.candidates.size() > kMaxCandidates) world.candidates.erase(world.candidates.begin());
    return false;
  }
  world.known = true;
  world.pivot = measurement.own.T_world_cam.translation();
  const double yaw = yaw_of(newest.linear());
  world.T_own_peer.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d p = measurement.other.T_world_cam.translation();
  world.T_own_peer.translation() = newest * p - world.T_own_peer.linear() * p;
  world.covariance.setZero();
  world.covariance.diagonal().head<3>().setConstant(kAlignedSigma_m * kAlignedSigma_m);
  world.covariance(5, 5) = kAlignedSigma_rad * kAlignedSigma_rad;
  world.candidates = std::move(agreeing);
  return true;
}

double DriftFilter::repetition(Drone& drone, TimeNs own_stamp_ns) const {
  constexpr double kShortest_s = 0.25;
  const std::optional<TimeNs> last_ns = std::exchange(drone.last_used_ns, own_stamp_ns);
  if (!last_ns) return 1;
  const double since_s = std::abs(seconds_between(*last_ns, own_stamp_ns));
  return std::max(1.0, config_.same_corners_s / std::max(since_s, kShortest_s));
}

// However often a peer answers, it sees the same corners: their errors do not average out.
bool DriftFilter::said_enough(const Drone& drone, std::uint64_t own_keyframe) const {
  const auto known = drone.heard.find(own_keyframe);
  if (known != drone.heard.end()) return known->second >= kMostPerKeyframe;
  const bool full = drone.heard.size() >= static_cast<std::size_t>(config_.max_keyframes);
  return full && own_keyframe < drone.heard.begin()->first;
}

void DriftFilter::count_used(Drone& drone, std::uint64_t own_keyframe) {
  ++drone.heard[own_keyframe];
  if (drone.heard.size() > static_cast<std::size_t>(config_.max_keyframes)) {
    drone.heard.erase(drone.heard.begin());
  }
}

DriftOutcome DriftFilter::use(int drone, const RelativePose& measurement) {
  const std::uint64_t own_keyframe = measurement.own.keyframe_id;
  if (said_enough(drones_[static_cast<std::size_t>(drone)], own_keyframe)) {
    return DriftOutcome::kRepeated;
  }
  make_room();
  const int own = find_or_insert(to_node(0, measurement.own));
  const int other = find_or_insert(to_node(drone, measurement.other));
  if (own == other) return DriftOutcome::kInvalid;
  const Node& k = nodes_[static_cast<std::size_t>(own)];
  const Node& m = nodes_[static_cast<std::size_t>(other)];
  const Eigen::Vector3d between = k.p - m.p;
  Matrix6d H_other = -Matrix6d::Identity();
  H_other.topRightCorner<3, 3>() = skew(between);
  Vector6d r;
  r.head<3>() = m.R * measurement.T_other_own.translation() - between;
  r.tail<3>() = log_so3(m.R * measurement.T_other_own.linear() * k.R.transpose());
  r -= x_.segment<kSize>(block(own)) + H_other * x_.segment<kSize>(block(other));

  const Eigen::MatrixXd PHt =
      P_.middleCols<kSize>(block(own)) + P_.middleCols<kSize>(block(other)) * H_other.transpose();
  Matrix6d S = repetition(drones_[static_cast<std::size_t>(drone)], k.stamp_ns) *
               rotated(measurement.covariance, m.R);
  S += PHt.middleRows<kSize>(block(own)) + H_other * PHt.middleRows<kSize>(block(other));
  const Eigen::LLT<Matrix6d> cholesky((S + S.transpose()) / 2);
  if (cholesky.info() != Eigen::Success) return DriftOutcome::kInvalid;
  last_distance_ = r.dot(cholesky.solve(r));
  if (last_distance_ > gate_limit_) return DriftOutcome::kGated;
  const Eigen::MatrixXd W = cholesky.matrixL().solve(PHt.transpose());  // P H^T inv(S) H P = W^T W
  x_ += W.transpose() * cholesky.matrixL().solve(r);
  P_ -= W.transpose() * W;
  count_used(drones_[static_cast<std::size_t>(drone)], own_keyframe);
  return DriftOutcome::kUsed;
}

Odometry DriftFilter::corrected(const Odometry& alone) const {
  Node now;
  now.stamp_ns = alone.stamp_ns + 1;
  const int last = neighbour(now, true);
  if (last < 0) return alone;
  const Node& node = nodes_[static_cast<std::size_t>(last)];
  const Eigen::Matrix3d R = alone.pose.q_world_imu.toRotationMatrix();
  Matrix6d to_world = Matrix6d::Identity();  // from [dp dtheta_local]
  to_world.bottomRightCorner<3, 3>() = alone.pose.q_world_imu.toRotationMatrix();
  const Step step = step_between(node.p, node.covariance, alone.pose.p_world_imu,
                                 to_world * alone.pose_covariance * to_world.transpose());
  const Vector6d drift = step.A * x_.segment<kSize>(block(last));
  const Matrix6d P =
      step.A * P_.block<kSize, kSize>(block(last), block(last)) * step.A.transpose() + step.Q;

  Odometry odometry = alone;
  const Eigen::Quaterniond turn = exp_quaternion(drift.tail<3>());
  odometry.pose.p_world_imu += drift.head<3>();
  odometry.pose.q_world_imu = (turn * alone.pose.q_world_imu).normalized();
  odometry.v_world_imu = turn * alone.v_world_imu;
  to_world.bottomRightCorner<3, 3>() = odometry.pose.q_world_imu.toRotationMatrix();
  odometry.pose_covariance = to_world.transpose() * P * to_world;
  return odometry;
}

std::optional<WorldAlignment> DriftFilter::alignment(const std::string& peer) const {
  int newest = -1;
  for (int i = 0; i < keyframes(); ++i) {
    const Node& node = nodes_[static_cast<std::size_t>(i)];
    if (node.drone == 0 || drones_[static_cast<std::size_t>(node.drone)].name != peer) continue;
    if (newest < 0 || node.stamp_ns > nodes_[static_cast<std::size_t>(newest)].stamp_ns) newest = i;
  }
  if (newest < 0) return std::nullopt;
  const Node& node = nodes_[static_cast<std::size_t>(newest)];
  const auto error = x_.segment<kSize>(block(newest));
  Eigen::Isometry3d correction = Eigen::Isometry3d::Identity();  // about the keyframe
  correction.linear() = exp_so3(error.tail<3>());
  correction.translation() = node.p + error.head<3>() - correction.linear() * node.p;
  const Matrix6d P = P_.block<kSize, kSize>(block(newest), block(newest));
  return WorldAlignment{
      correction * drones_[static_cast<std::size_t>(node.drone)].world.T_own_peer,
      std::sqrt(P.topLeftCorner<3, 3>().selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff()),
      std::sqrt(P(5, 5))};
}

}  // namespace covey
