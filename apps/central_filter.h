// SPDX-License-Identifier: Apache-2.0
//
// The ceiling of what any exchange can give: one filter that holds all drones and their landmarks
// with every covariance between them, is given every bearing at once, and knows which are of one
// landmark. No drone could fly with it; it is what a study compares with.
//
// Error state: [dp dv dtheta dbg dba] of each drone, then, in the order in which they came, [dp
// dtheta] of clones and positions of landmarks in the world. First-estimate Jacobians throughout.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <unordered_map>
#include <vector>

#include "estimator/config.h"
#include "estimator/imu_buffer.h"
#include "estimator/imu_transition.h"
#include "estimator/keyframe_policy.h"
#include "estimator/measurements.h"

namespace covey {

struct CentralConfig {
  EstimatorConfig estimator;
  std::size_t max_landmarks = 240;  // those not seen for longest leave first
  std::size_t min_bearings = 4;     // of a landmark, before it joins the state
  double max_depth_error = 0.1;     // of its distance, standard deviation over value
};

// Where a drone starts. Independent of the others: they have not met yet.
struct CentralStart {
  ImuState imu;
  Matrix15d covariance = Matrix15d::Identity();
  CameraExtrinsics extrinsics;
};

class CentralFilter {
 public:
  CentralFilter(const CentralConfig& config, const std::vector<CentralStart>& drones);

  void add_imu(std::size_t drone, const ImuSample& sample);

  // One image of each drone, all of one instant: which landmark each track shows.
  struct Image {
    CameraMeasurement camera;
    std::vector<std::size_t> landmarks;  // one for each track
  };
  // Needs IMU samples of all drones up to the instant.
  void add_images(const std::vector<Image>& images);

  [[nodiscard]] Odometry odometry(std::size_t drone) const;

 private:
  struct Bearing {
    Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
    Eigen::Matrix2d whitening = Eigen::Matrix2d::Identity();
  };
  struct Clone {
    TimeNs stamp_ns = 0;
    bool keyframe = false;
    int offset = 0;
    Pose pose, first;
    std::unordered_map<std::size_t, Bearing> seen;  // landmarks that are not in the state
  };
  struct Drone {
    CameraExtrinsics extrinsics;
    ImuBuffer buffer;
    ImuState imu, first;
    std::vector<Clone> clones;
    TrackList reference;  // of the last keyframe
  };
  struct Landmark {
    std::size_t id = 0;
    int offset = 0;
    TimeNs seen_ns = 0;
    Eigen::Vector3d p_world = Eigen::Vector3d::Zero(), first = Eigen::Vector3d::Zero();
  };
  // A bearing that has not counted yet.
  struct Sight {
    const Drone* drone = nullptr;
    const Clone* clone = nullptr;
    Bearing bearing;
  };
  // One bearing's whitened rows: r = J_pose dx_clone + J_point dx_landmark + n.
  struct Rows {
    int clone_offset = 0, landmark_offset = 0;
    Eigen::Matrix<double, 2, 6> J_pose;
    Eigen::Matrix<double, 2, 3> J_point;
    Eigen::Vector2d r;
  };

  void propagate(std::size_t drone, TimeNs stamp_ns);
  void clone(std::size_t drone, const CameraMeasurement& image);
  [[nodiscard]] bool becomes_keyframe(const Drone& drone, const TrackList& tracks) const;
  void update_known(const std::vector<Image>& images);
  void meet_new(const std::vector<Image>& images);
  // Whether it could be; it is worth another try with more bearings.
  bool meet(std::size_t id);
  [[nodiscard]] std::vector<Sight> sights_of(std::size_t id) const;
  [[nodiscard]] std::optional<Landmark> locate(std::size_t id,
                                               const std::vector<Sight>& sights) const;
  void join(Landmark landmark, const Eigen::Matrix3d& R_inverse, const Eigen::MatrixXd& H,
            const Eigen::Vector3d& r);
  void forget_clones();
  void forget_landmarks();
  [[nodiscard]] static std::optional<Rows> rows_of(const Drone& drone, const Clone& clone,
                                                   const Landmark& landmark,
                                                   const Bearing& bearing);
  // r = H dx + n with unit noise, dense.
  void update(const Eigen::MatrixXd& H, const Eigen::VectorXd& r);
  // The same out of P H^T and the innovation's covariance.
  void correct(const Eigen::MatrixXd& PHt, const Eigen::MatrixXd& S, const Eigen::VectorXd& r);
  void apply(const Eigen::VectorXd& dx);
  void grow(int size);
  void remove(int offset, int size);

  CentralConfig config_;
  std::vector<Drone> drones_;
  std::vector<Landmark> landmarks_;
  std::unordered_map<std::size_t, std::size_t> index_of_;  // landmark's id -> landmarks_
  Eigen::MatrixXd P_;
};

}  // namespace covey
