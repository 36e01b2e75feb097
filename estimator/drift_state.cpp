// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_state.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdlib>
#include <limits>

#include "estimator/drift_step.h"

namespace covey {

DriftState::Neighbours DriftState::neighbours(std::size_t drone, TimeNs stamp_ns) const {
  Neighbours found;
  for (int i = 0; i < keyframes(); ++i) {
    const Node& other = node(i);
    if (other.drone != drone || other.stamp_ns == stamp_ns) continue;
    int& best = other.stamp_ns < stamp_ns ? found.earlier : found.later;
    const auto distance = [&](int index) { return std::abs(node(index).stamp_ns - stamp_ns); };
    if (best < 0 || distance(i) < distance(best)) best = i;
  }
  return found;
}

int DriftState::find_or_insert(const Node& wanted) {
  for (int i = 0; i < keyframes(); ++i) {
    if (node(i).drone == wanted.drone && node(i).keyframe_id == wanted.keyframe_id) return i;
  }
  const Neighbours near = neighbours(wanted.drone, wanted.stamp_ns);
  // What the earlier one says of it, or only the odometry; then what the later one adds.
  DriftStep from_earlier{Matrix6d::Zero(), wanted.covariance};
  if (near.earlier >= 0) {
    const Node& earlier = node(near.earlier);
    from_earlier = drift_step(earlier.p, earlier.covariance, wanted.p, wanted.covariance);
  }
  Matrix6d from_later = Matrix6d::Zero();
  if (near.later >= 0) {
    const Node& later = node(near.later);
    const DriftStep onward = drift_step(wanted.p, wanted.covariance, later.p, later.covariance);
    const Matrix6d Q = from_earlier.Q;
    const Matrix6d S = onward.A * Q * onward.A.transpose() + onward.Q;
    from_later = S.llt().solve(onward.A * Q).transpose();
    const Matrix6d rest = Matrix6d::Identity() - from_later * onward.A;
    from_earlier.A = rest * from_earlier.A;
    from_earlier.Q = rest * Q * rest.transpose() + from_later * onward.Q * from_later.transpose();
  }
  append(wanted, near, from_earlier.A, from_later, from_earlier.Q);
  return keyframes() - 1;
}

void DriftState::reserve(Eigen::Index size) {
  if (size <= x_.size()) return;
  const Eigen::Index room = std::max<Eigen::Index>(size, 2 * x_.size());
  x_.conservativeResize(room);
  P_.conservativeResize(room, room);
}

// e = A_earlier e_earlier + A_later e_later + w, cov(w) = Q.
void DriftState::append(const Node& node, const Neighbours& from, const Matrix6d& A_earlier,
                        const Matrix6d& A_later, const Matrix6d& Q) {
  const Eigen::Index n = size();
  reserve(n + kSize);
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(kSize, n);
  Vector6d mean = Vector6d::Zero();
  Matrix6d covariance = Q;
  const auto take = [&](int neighbour, const Matrix6d& A) {
    if (neighbour < 0) return;
    cross.noalias() += A * P_.block(block(neighbour), 0, kSize, n);
    mean += A * x_.segment<kSize>(block(neighbour));
  };
  take(from.earlier, A_earlier);
  take(from.later, A_later);
  if (from.earlier >= 0) {
    covariance += cross.middleCols<kSize>(block(from.earlier)) * A_earlier.transpose();
  }
  if (from.later >= 0) {
    covariance += cross.middleCols<kSize>(block(from.later)) * A_later.transpose();
  }
  x_.segment<kSize>(n) = mean;
  P_.block(n, 0, kSize, n) = cross;
  P_.block(0, n, n, kSize) = cross.transpose();
  P_.block<kSize, kSize>(n, n) = (covariance + covariance.transpose()) / 2;
  nodes_.push_back(node);
}

void DriftState::forget(int index) {
  const Eigen::Index n = size(), from = n - kSize, to = block(index);
  if (to != from) {
    nodes_[static_cast<std::size_t>(index)] = nodes_.back();
    x_.segment<kSize>(to) = x_.segment<kSize>(from);
    P_.block(0, to, n, kSize) = P_.block(0, from, n, kSize);
    P_.block(to, 0, kSize, n) = P_.block(from, 0, kSize, n);
  }
  nodes_.pop_back();
}

// Forgets the keyframe whose neighbours on its drone's way are closest in time; of each drone the
// first and the last stay, if that is possible.
void DriftState::shrink_to(int most) {
  while (keyframes() > most) {
    int closest = 0;
    TimeNs shortest = std::numeric_limits<TimeNs>::max();
    for (int i = 0; i < keyframes(); ++i) {
      const Neighbours near = neighbours(node(i).drone, node(i).stamp_ns);
      if (near.earlier < 0 || near.later < 0) continue;
      const TimeNs span = node(near.later).stamp_ns - node(near.earlier).stamp_ns;
      if (span >= shortest) continue;
      closest = i;
      shortest = span;
    }
    forget(closest);
  }
}

void DriftState::save() {
  saved_.nodes = nodes_;
  if (saved_.P.rows() != P_.rows()) {
    saved_.x.resize(x_.size());
    saved_.P.resize(P_.rows(), P_.cols());
  }
  saved_.x.head(size()) = x_.head(size());
  saved_.P.topLeftCorner(size(), size()) = P_.topLeftCorner(size(), size());
}

void DriftState::restore() {
  nodes_ = saved_.nodes;
  x_.head(size()) = saved_.x.head(size());
  P_.topLeftCorner(size(), size()) = saved_.P.topLeftCorner(size(), size());
}

}  // namespace covey
