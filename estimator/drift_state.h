// SPDX-License-Identifier: Apache-2.0
//
// The drift filter's state: the pose errors e = [dp dtheta] (world axes, R = Exp(dtheta) R^) of
// keyframes, each as its drone's odometry had it, and one covariance. Along one drone errors grow
// as odometry says:
//   e_b = F_ab e_a + w,   F_ab = [I  -[p_b - p_a]x zz^T; 0  I],   cov(w) = P_b - F_ab P_a F_ab^T,
// (yaw turns what comes after it; tilt is kept by gravity and does not) as far as it becomes less
// certain; what it becomes surer of: drift_step. A keyframe is put into its drone's chain when it
// is first needed, between those that are there (Brownian bridge).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

class DriftState {
 public:
  static constexpr int kSize = 6;  // of one keyframe's error

  struct Node {
    std::size_t drone = 0;  // 0: own
    std::uint64_t keyframe_id = 0;
    TimeNs stamp_ns = 0;
    Eigen::Vector3d p = Eigen::Vector3d::Zero();  // nominal, in the own world
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    Matrix6d covariance = Matrix6d::Zero();  // of the drone's odometry alone, in the own world
  };

  // Nodes are named by their index, until one is forgotten.
  [[nodiscard]] int keyframes() const { return static_cast<int>(nodes_.size()); }
  [[nodiscard]] const std::vector<Node>& nodes() const { return nodes_; }
  [[nodiscard]] const Node& node(int index) const {
    return nodes_[static_cast<std::size_t>(index)];
  }
  // Where a node's error begins among all.
  [[nodiscard]] static constexpr int block(int index) { return kSize * index; }
  [[nodiscard]] auto error(int index) const { return x_.segment<kSize>(block(index)); }
  [[nodiscard]] auto covariance_of(int index) const {
    return P_.block<kSize, kSize>(block(index), block(index));
  }
  // Of the errors of all nodes.
  [[nodiscard]] auto covariance() const { return P_.topLeftCorner(size(), size()); }

  // The nearest in time of the drone's; -1: none.
  struct Neighbours {
    int earlier = -1, later = -1;
  };
  [[nodiscard]] Neighbours neighbours(std::size_t drone, TimeNs stamp_ns) const;

  [[nodiscard]] int find_or_insert(const Node& wanted);
  // The last node takes its place.
  void forget(int index);
  // Forgets keyframes until there are at most so many.
  void shrink_to(int most);

  // A Kalman filter's update: e += W^T r and P -= W^T W, for a residual and its innovation
  // covariance S = L L^T whitened: r = inv(L) residual, W = inv(L) H P.
  void correct(const Eigen::MatrixXd& W, const Vector7d& r) {
    x_.head(size()) += W.transpose() * r;
    P_.topLeftCorner(size(), size()).noalias() -= W.transpose() * W;
  }

  void save();  // to return to, once
  void restore();

 private:
  [[nodiscard]] Eigen::Index size() const { return block(keyframes()); }
  void append(const Node& node, const Neighbours& from, const Matrix6d& A_earlier,
              const Matrix6d& A_later, const Matrix6d& Q);
  void reserve(Eigen::Index size);

  std::vector<Node> nodes_;
  // kSize per node; with room behind them, so that nodes that come and go move no others.
  Eigen::VectorXd x_;
  Eigen::MatrixXd P_;
  struct Saved {
    std::vector<Node> nodes;
    Eigen::VectorXd x;
    Eigen::MatrixXd P;
  };
  Saved saved_;
};

}  // namespace covey
