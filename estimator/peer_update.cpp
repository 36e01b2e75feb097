// SPDX-License-Identifier: Apache-2.0
#include "estimator/peer_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <utility>

#include "estimator/chi_square.h"
#include "estimator/covariance_intersection.h"
#include "estimator/observation_model.h"
#include "estimator/positive_definite.h"
#include "estimator/so3.h"

namespace covey {
namespace {

// A peer helps where it knows much better. Between equals each fusion only trades one drift for
// another, and what peers had from each other comes back: this share of the own variance of y must
// go, averaged over its four components.
constexpr double kMinGain = 0.35;

constexpr int kMinLandmarks = 4;
constexpr int kIterations = 8;
constexpr double kConverged = 1e-5;  // m and rad

// One landmark about a hypothesis of the keyframe's pose: r = H dx + B e + n, with e = [dp dtheta]
// of the pose.
struct Row {
  bool in_front = false;
  Eigen::VectorXd r;
  Eigen::MatrixXd H, noise;
  Eigen::Matrix<double, Eigen::Dynamic, 6> B;
  Eigen::MatrixXd W;  // weight: of the noise, and of what the state does not know of a SLAM feature
};

Row linearize(const State& state, const SharedLandmark& landmark,
              const Eigen::Isometry3d& T_world_other) {
  Row row;
  const LandmarkRows& own = landmark.own;
  const CameraExtrinsics& extrinsics = state.extrinsics();
  const int anchor_index = state.find_clone(own.landmark.anchor_id);
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  const Eigen::Vector3d from_camera = T_world_other.linear() * landmark.p_other;
  const auto f =
      inverse_depth_of_point(T_world_other.translation() + from_camera, anchor.pose, extrinsics);
  if (!f.in_front) return row;
  const AnchoredPoint first = anchored_point(f.inverse_depth, anchor.first, extrinsics);
  const auto at_first = inverse_depth_of_point(first.p_world, anchor.first, extrinsics);
  const Eigen::MatrixXd J_point = own.R * at_first.J_point;
  Eigen::Matrix<double, 3, 6> J_pose;
  J_pose << Eigen::Matrix3d::Identity(), -skew(from_camera);
  const Eigen::MatrixXd J_other = J_point * T_world_other.linear();
  row.in_front = true;
  row.r = own.r - own.R * (f.inverse_depth - own.landmark.inverse_depth);
  row.B = J_point * J_pose;
  row.H = own.H;
  row.H.middleCols(state.clone_offset(anchor_index), 6) += own.R * at_first.J_pose;
  if (state.extrinsics_offset() >= 0) {
    row.H.middleCols(state.extrinsics_offset(), 6) += own.R * at_first.J_extrinsics;
  }
  row.noise = own.noise + J_other * landmark.covariance * J_other.transpose();
  Eigen::MatrixXd spread = row.noise;
  if (const int index = state.find_landmark(own.landmark.track_id); index >= 0) {
    const int offset = state.landmark_offset(index);
    spread += state.covariance().block<3, 3>(offset, offset);
  }
  row.W = spread.inverse();
  return row;
}

std::vector<Row> linearize(const State& state, const SharedKeyframe& keyframe,
                           const Eigen::Isometry3d& T_world_other) {
  std::vector<Row> rows;
  for (const SharedLandmark& landmark : keyframe.landmarks) {
    Row row = linearize(state, landmark, T_world_other);
    if (!row.in_front) continue;
    // Outliers keep a pull that no longer grows with their distance (Cauchy).
    row.W /= 1 + row.r.dot(row.W * row.r) / kOutlierChiSquare;
    rows.push_back(std::move(row));
  }
  return rows;
}

bool plausible(const SharedLandmark& landmark) {
  return landmark.p_other.allFinite() && is_positive_definite<3>(landmark.covariance);
}

bool plausible(const KeyframePose& pose) {
  return pose.T_world_cam.matrix().allFinite() && is_positive_definite<6>(pose.covariance);
}

void drop_implausible(SharedKeyframe& keyframe, PeerReport& report) {
  const bool no_pose = !plausible(keyframe.other);
  auto& landmarks = keyframe.landmarks;
  const auto end = std::remove_if(
      landmarks.begin(), landmarks.end(),
      [&](const SharedLandmark& landmark) { return no_pose || !plausible(landmark); });
  report.invalid += static_cast<int>(landmarks.end() - end);
  landmarks.erase(end, landmarks.end());
}

// Position and yaw out of [dp dtheta].
Eigen::Matrix4d drift_of(const Matrix6d& M) {
  Eigen::Matrix4d drift;
  drift << M.topLeftCorner<3, 3>(), M.block<3, 1>(0, 5), M.block<1, 3>(5, 0), M(5, 5);
  return drift;
}

Eigen::Vector4d drift_between(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
  Eigen::Vector4d drift;
  drift << to.translation() - from.translation(),
      log_so3(to.linear() * from.linear().transpose()).z();
  return drift;
}

// Each landmark against the pose that all of them give.
void gate_landmarks(const State& state, const Sighting& sighting, const PeerGate& gate,
                    SharedKeyframe& keyframe, PeerReport& report) {
  const auto disagrees = [&](const SharedLandmark& landmark) {
    const Row row = linearize(state, landmark, sighting.T_world_other);
    if (!row.in_front) return true;
    const Eigen::MatrixXd H = row.H + row.B * sighting.Y;
    const Eigen::MatrixXd HP = H * state.covariance();
    const Eigen::MatrixXd S = HP * H.transpose() + row.noise;
    const double limit = row.r.size() == 2 ? gate.landmark_2dof : gate.landmark_3dof;
    return !(row.r.dot(S.ldlt().solve(row.r)) < limit);
  };
  auto& landmarks = keyframe.landmarks;
  const auto end = std::remove_if(landmarks.begin(), landmarks.end(), disagrees);
  report.gated += static_cast<int>(landmarks.end() - end);
  landmarks.erase(end, landmarks.end());
}

}  // namespace

PeerGate::PeerGate(double confidence)
    : landmark_2dof(chi_square_quantile(confidence, 2)),
      landmark_3dof(chi_square_quantile(confidence, 3)),
      keyframe_4dof(chi_square_quantile(confidence, 4)) {}

std::optional<SharedLandmark> landmark_of(const LandmarkMatch& match) {
  constexpr double kFarthest = 1e-4;  // 1/m
  if (!(match.inverse_depth > kFarthest)) return std::nullopt;
  SharedLandmark landmark;
  landmark.p_other = match.other_bearing.homogeneous() / match.inverse_depth;
  const Eigen::Vector3d by_depth =
      landmark.p_other / match.inverse_depth * match.inverse_depth_sigma;
  const double by_bearing = match.bearing_covariance.trace() / 2 * landmark.p_other.squaredNorm();
  landmark.covariance = by_bearing * Eigen::Matrix3d::Identity() + by_depth * by_depth.transpose();
  return landmark;
}

LandmarkRows rows_of(const State& state, int landmark_index) {
  LandmarkRows rows;
  rows.landmark = state.landmarks()[static_cast<std::size_t>(landmark_index)];
  rows.R = Eigen::Matrix3d::Identity();
  rows.H = Eigen::MatrixXd::Zero(3, state.dimension());
  rows.H.middleCols<3>(state.landmark_offset(landmark_index)) = -Eigen::Matrix3d::Identity();
  rows.r = Eigen::Vector3d::Zero();
  rows.noise = Eigen::Matrix3d::Zero();
  return rows;
}

std::optional<Sighting> sight(const State& state, const SharedKeyframe& keyframe) {
  Sighting sighting;
  sighting.T_world_other = keyframe.T_world_other;
  for (int i = 0; i < kIterations; ++i) {
    const std::vector<Row> rows = linearize(state, keyframe, sighting.T_world_other);
    if (static_cast<int>(rows.size()) < kMinLandmarks) return std::nullopt;
    Matrix6d A = Matrix6d::Zero(), spread = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
    Eigen::MatrixXd AY = Eigen::MatrixXd::Zero(6, state.dimension());
    for (const Row& row : rows) {
      const Eigen::MatrixXd BW = row.B.transpose() * row.W;
      A += BW * row.B;
      b += BW * row.r;
      spread += BW * row.noise * BW.transpose();
      AY -= BW * row.H;
    }
    const Eigen::LLT<Matrix6d> cholesky(A);
    if (cholesky.info() != Eigen::Success || cholesky.rcond() < 1e-12) return std::nullopt;
    const Vector6d step = cholesky.solve(b);
    sighting.Y = cholesky.solve(AY);
    sighting.noise = cholesky.solve(cholesky.solve(spread).transpose());
    sighting.T_world_other.translation() += step.head<3>();
    sighting.T_world_other.linear() = exp_so3(step.tail<3>()) * sighting.T_world_other.linear();
    if (step.cwiseAbs().maxCoeff() < kConverged) break;
  }
  return sighting;
}

PeerReport update_from_peer(State& state, SharedKeyframe keyframe, const PeerGate& gate) {
  PeerReport report;
  drop_implausible(keyframe, report);
  std::optional<Sighting> own = sight(state, keyframe);
  if (own) {
    gate_landmarks(state, *own, gate, keyframe, report);
    own = sight(state, keyframe);
  }
  const int count = static_cast<int>(keyframe.landmarks.size());
  if (!own) {
    report.uninformative += count;
    return report;
  }
  Eigen::MatrixXd Y(4, state.dimension());
  Y << own->Y.topRows<3>(), own->Y.row(5);
  const Eigen::MatrixXd PYt = state.covariance() * Y.transpose();
  const Eigen::Matrix4d of_state = Y * PYt;
  const Eigen::Matrix4d S = of_state + drift_of(own->noise);
  const Eigen::Matrix4d S_peer = drift_of(keyframe.other.covariance);
  const Eigen::Vector4d difference = drift_between(own->T_world_other, keyframe.other.T_world_cam);
  if (!(difference.dot((S + S_peer).ldlt().solve(difference)) < gate.keyframe_4dof)) {
    report.gated += count;
    return report;
  }
  // What is minimised is the variance that y has from the state once the change is carried to it,
  // as a share of what it was: tr(inv(A) (A - A inv(S) (S - C) inv(S) A)) for A = Y P Y^T.
  const Eigen::Matrix4d S_inverse = S.inverse();
  const Eigen::Matrix4d Q = S_inverse * of_state * S_inverse;
  const Intersection fused = intersect_covariances(S, S_peer, Q);
  if (!((Q * (S - fused.covariance)).trace() > 4 * kMinGain)) {
    report.uninformative += count;
    return report;
  }
  report.used += count;
  const Eigen::MatrixXd G = PYt * S_inverse;
  state.correct(G * (fused.K * difference), G, S - fused.covariance);
  return report;
}

}  // namespace covey
