// SPDX-License-Identifier: Apache-2.0
#include "apps/path_figures.h"

#include <Eigen/Cholesky>

#include "apps/evaluation.h"

namespace covey {

NeesSample nees_of(const Odometry& odometry, const Pose& truth) {
  const PoseError error = pose_error({odometry.stamp_ns, odometry.pose, truth});
  const Eigen::Matrix3d P_p = odometry.pose_covariance.topLeftCorner<3, 3>();
  const Eigen::Matrix3d P_theta = odometry.pose_covariance.bottomRightCorner<3, 3>();
  return {error.position_world.dot(P_p.llt().solve(error.position_world)),
          error.rotation_imu.dot(P_theta.llt().solve(error.rotation_imu))};
}

PathFigures figures_of(const FlownPath& path) {
  std::vector<PosePair> pairs;
  PathFigures figures;
  const auto count = static_cast<double>(path.odometry.size());
  for (std::size_t k = 0; k < path.odometry.size(); ++k) {
    const Odometry& odometry = path.odometry[k];
    pairs.push_back({odometry.stamp_ns, odometry.pose, path.truth[k]});
    const NeesSample nees = nees_of(odometry, path.truth[k]);
    figures.position_nees += nees.position / count;
    figures.orientation_nees += nees.orientation / count;
  }
  figures.aligned_m = absolute_error(pairs, Alignment::kSe3).position_m.rmse;
  figures.unaligned_m = absolute_error(pairs, Alignment::kNone).position_m.rmse;
  return figures;
}

}  // namespace covey
