// SPDX-License-Identifier: Apache-2.0
#include "estimator/relative_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "estimator/chi_square.h"
#include "estimator/drift_step.h"
#include "estimator/match_row.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr int kIterations = 15;
constexpr double kConverged = 1e-6;  // m, rad and log ratio
// Corners of two drones agree but for what is wrong. What was found in the image lies nearer than
// its sigma by half, or far off (flights in four scenes): a tail as Cauchy's distribution has it.
constexpr double kCornerTail = kOutlierChiSquare, kFoundTail = 1;
constexpr double kUnknownRatio = 1;  // standard deviation of a log ratio of which nothing is known
constexpr double kSureRatio = 0.02;  // less certain than that, it says nothing about odometry

struct Sightings {
  const std::vector<LandmarkMatch>& landmarks;
  double tail;  // chi-square beyond which a match's pull no longer grows with its distance
};

Sightings best_of(const KeyframeMatch& match, int min_inliers) {
  if (match.aligned.size() >= static_cast<std::size_t>(min_inliers)) {
    return {match.aligned, kFoundTail};
  }
  return {match.matches, kCornerTail};
}

struct Hypothesis {
  Eigen::Isometry3d T_other_own = Eigen::Isometry3d::Identity();
  double log_ratio = 0;
};

struct Normal {
  Matrix7d A = Matrix7d::Zero();
  Vector7d b = Vector7d::Zero();
  int inliers = 0;
};

// Cauchy's weights; inliers are counted.
Normal accumulate(const Sightings& sightings, const Hypothesis& hypothesis, double tail) {
  Normal normal;
  normal.A(6, 6) = 1 / (kUnknownRatio * kUnknownRatio);
  normal.b(6) = -hypothesis.log_ratio * normal.A(6, 6);
  for (const LandmarkMatch& landmark : sightings.landmarks) {
    const MatchRow row = match_row(hypothesis.T_other_own, hypothesis.log_ratio, landmark);
    if (!row.in_front) continue;
    const Eigen::Matrix3d W = row.covariance.inverse();
    const double distance = row.r.dot(W * row.r);
    const double weight = 1 / (1 + distance / tail);
    normal.A += weight * row.J.transpose() * W * row.J;
    normal.b += weight * row.J.transpose() * W * row.r;
    normal.inliers += distance < kOutlierChiSquare ? 1 : 0;
  }
  return normal;
}

// From afar all matches are heard; who disagrees is left out as the pose gets better.
std::optional<Normal> solve(const Sightings& sightings, Hypothesis& hypothesis) {
  constexpr double kWidest = 9216, kNarrower = 0.25;  // chi-square
  double tail = kWidest;
  Normal normal;
  for (int i = 0; i < kIterations; ++i) {
    tail = std::max(sightings.tail, kNarrower * tail);
    normal = accumulate(sightings, hypothesis, tail);
    const Vector7d step = normal.A.ldlt().solve(normal.b);
    if (!step.allFinite()) return std::nullopt;
    hypothesis.T_other_own.translation() += step.head<3>();
    hypothesis.T_other_own.linear() = exp_so3(step.segment<3>(3)) * hypothesis.T_other_own.linear();
    hypothesis.log_ratio += step(6);
    if (tail == sightings.tail && step.cwiseAbs().maxCoeff() < kConverged) break;
  }
  return normal;
}

// By what share all depths may be wrong together. As much as the way on which they were measured,
// which whoever uses the pose sees (DriftObservation); but where there was hardly one, no landmark
// is surer than what all of them share.
double shared_depth_sigma(const KeyframeMatch& match, const std::vector<LandmarkMatch>& landmarks) {
  if (is_depth_baseline(match.other_before.T_world_cam.translation(),
                        match.other.T_world_cam.translation())) {
    return 0;
  }
  double least = std::numeric_limits<double>::max();
  for (const LandmarkMatch& landmark : landmarks) {
    least = std::min(least, landmark.inverse_depth_sigma / landmark.inverse_depth);
  }
  return least;
}

// Of the seventh component; none if it is too uncertain to tell.
std::optional<DepthRatio> sure_ratio(double log_ratio, const Matrix7d& covariance) {
  if (!(covariance(6, 6) < kSureRatio * kSureRatio)) return std::nullopt;
  return DepthRatio{log_ratio, covariance(6, 6), covariance.topRightCorner<6, 1>()};
}

}  // namespace

std::optional<RelativePose> estimate_relative_pose(const KeyframeMatch& match, int min_inliers) {
  Hypothesis found{match.T_other_own, 0};
  const Sightings sightings = best_of(match, min_inliers);
  const std::optional<Normal> normal = solve(sightings, found);
  if (!normal || normal->inliers < min_inliers) return std::nullopt;
  const Eigen::LLT<Matrix7d> cholesky(normal->A);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  Matrix7d covariance = cholesky.solve(Matrix7d::Identity());
  const Eigen::Vector3d by_depths =
      shared_depth_sigma(match, sightings.landmarks) * found.T_other_own.translation();
  covariance.topLeftCorner<3, 3>() += by_depths * by_depths.transpose();
  const Eigen::LLT<Matrix6d> fixed(covariance.topLeftCorner<6, 6>());
  if (fixed.info() != Eigen::Success || fixed.rcond() < 1e-12) return std::nullopt;
  RelativePose pose;
  pose.drone = match.drone;
  pose.own = match.own;
  pose.own_before = match.own_before;
  pose.own_mean_depth = match.own_mean_depth;
  pose.other = match.other;
  pose.other_before = match.other_before;
  pose.T_other_own = found.T_other_own;
  pose.covariance = covariance.topLeftCorner<6, 6>();
  pose.inliers = normal->inliers;
  pose.depth_ratio = sure_ratio(found.log_ratio, covariance);
  return pose;
}

PeerKeyframe as_told(const RelativePose& measurement, const std::string& own_name) {
  PeerKeyframe message;
  message.sender = own_name;
  message.receiver = measurement.drone;
  message.request_keyframe_id = measurement.own.keyframe_id;
  message.pose = measurement.own;
  // Of the own depths a ratio alone tells something.
  message.before = measurement.depth_ratio ? measurement.own_before : measurement.own;
  FoundKeyframe& found = message.found.emplace();
  found.keyframe_id = measurement.other.keyframe_id;
  found.T_keyframe_cam = measurement.T_other_own;
  found.covariance.topLeftCorner<6, 6>() = measurement.covariance;
  if (const auto& ratio = measurement.depth_ratio) {
    found.log_depth_ratio = ratio->log_ratio;
    found.covariance.topRightCorner<6, 1>() = ratio->covariance_with_pose;
    found.covariance.bottomLeftCorner<1, 6>() = ratio->covariance_with_pose.transpose();
    found.covariance(6, 6) = ratio->variance;
  }
  return message;
}

// T_other_own is the inverse of what was found: with R = Exp(dtheta) R^ its errors are
// -R dp + [p]x R dtheta and -R dtheta (R, p: of T_other_own), and the ratio is turned over too.
RelativePose found_by_peer(const PeerKeyframe& message, const KeyframePose& own,
                           const KeyframePose& own_before, double own_mean_depth) {
  const FoundKeyframe& found = *message.found;
  RelativePose pose;
  pose.drone = message.sender;
  pose.own = own;
  pose.own_before = own_before;
  pose.own_mean_depth = own_mean_depth;
  pose.other = message.pose;
  pose.other_before = message.before;
  pose.found_by_other = true;
  pose.T_other_own = found.T_keyframe_cam.inverse();
  const Eigen::Matrix3d R = pose.T_other_own.linear();
  Matrix7d J = Matrix7d::Zero();
  J.topLeftCorner<3, 3>() = -R;
  J.block<3, 3>(0, 3) = skew(Eigen::Vector3d(pose.T_other_own.translation())) * R;
  J.block<3, 3>(3, 3) = -R;
  J(6, 6) = -1;
  const Matrix7d covariance = J * found.covariance * J.transpose();
  pose.covariance = covariance.topLeftCorner<6, 6>();
  pose.depth_ratio = sure_ratio(-found.log_depth_ratio, covariance);
  return pose;
}

}  // namespace covey
