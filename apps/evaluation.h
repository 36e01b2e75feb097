// SPDX-License-Identifier: Apache-2.0
//
// How far an estimated trajectory is from the true one: ATE, RPE, rotation error, NEES. Pure maths.
// Definitions as in Zhang and Scaramuzza, "A Tutorial on Quantitative Trajectory Evaluation for
// Visual(-Inertial) Odometry" (IROS 2018), whose tool gives the same figures.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "apps/trajectory_file.h"
#include "estimator/measurements.h"

namespace covey {

// An estimate and the truth at the same moment.
struct PosePair {
  TimeNs stamp_ns = 0;  // of the estimate
  Pose estimate;
  Pose truth;
};

enum class Association {
  kInterpolate,  // truth interpolated at the estimate's stamps
  kNearest,      // closest stamps first, one to one, closer than max_difference_s
};

struct AssociationOptions {
  Association method = Association::kInterpolate;
  double max_difference_s = 0.02;         // s, for kNearest
  double max_gap_s = kLongestTruthGap_s;  // for kInterpolate: none over longer holes
};

// Throws when fewer than three poses match: no figure can be made of that, least of all a zero.
[[nodiscard]] std::vector<PosePair> associate(const StampedPoses& estimate,
                                              const StampedPoses& truth,
                                              const AssociationOptions& options);

enum class Alignment { kNone, kPosYaw, kSe3, kSim3 };

// x_truth = scale * R * x_estimate + t
struct Similarity {
  double scale = 1;
  Eigen::Matrix3d R_truth_estimate = Eigen::Matrix3d::Identity();
  Eigen::Vector3d t_truth_estimate = Eigen::Vector3d::Zero();
};

// Least squares over all positions (Umeyama, PAMI 1991); kPosYaw: translation and rotation about z.
[[nodiscard]] Similarity align(const std::vector<PosePair>& pairs, Alignment alignment);
[[nodiscard]] Pose transform(const Similarity& similarity, const Pose& estimate);

struct ErrorStatistics {
  double rmse = 0, mean = 0, std = 0, max = 0;  // std: of the population
};

[[nodiscard]] ErrorStatistics statistics(const std::vector<double>& errors);

struct AbsoluteError {
  ErrorStatistics position_m;
  ErrorStatistics rotation_deg;
  double scale = 1;
};

[[nodiscard]] AbsoluteError absolute_error(const std::vector<PosePair>& pairs, Alignment alignment);

// Error of the motion over stretches of the same length or duration; independent of alignment.
struct RelativeError {
  double length = 0;  // m or s
  int stretches = 0;
  ErrorStatistics position_m;
  ErrorStatistics rotation_deg;
};

// Nothing where the trajectory is too short for one stretch.
[[nodiscard]] std::optional<RelativeError> relative_error_over_distance(
    const std::vector<PosePair>& pairs, double distance_m);
[[nodiscard]] std::optional<RelativeError> relative_error_over_time(
    const std::vector<PosePair>& pairs, double interval_s);

// Mean normalised estimation error squared; 3 for an honest filter. Errors are not aligned: the
// covariance speaks of the world that drones share.
struct Nees {
  int samples = 0;
  double position = 0;
  double orientation = 0;
};

// Nothing where no covariance belongs to a pair. Throws when a covariance is not positive definite.
[[nodiscard]] std::optional<Nees> nees(const std::vector<PosePair>& pairs,
                                       const std::vector<StampedCovariance>& covariances);

// truth - estimate in world (m), and Log(q_estimate^-1 q_truth) (rad): what the covariance
// describes.
struct PoseError {
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation_imu = Eigen::Vector3d::Zero();
};
[[nodiscard]] PoseError pose_error(const PosePair& pair);

[[nodiscard]] double path_length_m(const StampedPoses& trajectory);
[[nodiscard]] double path_length_m(const std::vector<PosePair>& pairs);  // of the truth

}  // namespace covey
