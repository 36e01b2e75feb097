// SPDX-License-Identifier: Apache-2.0
#include "estimator/state_snapshot.h"

#include <cstdint>
#include <vector>

namespace covey {
namespace {

// Appends to FilterSnapshot::state.
class StateWriter {
 public:
  explicit StateWriter(Eigen::VectorXd& state) : state_(state) {}
  StateWriter& operator<<(const Eigen::Vector3d& v) {
    state_.segment<3>(next_) = v;
    next_ += 3;
    return *this;
  }
  StateWriter& operator<<(const Eigen::Quaterniond& q) {
    state_.segment<4>(next_) = q.coeffs();
    next_ += 4;
    return *this;
  }
  StateWriter& operator<<(double value) {
    state_[next_++] = value;
    return *this;
  }

 private:
  Eigen::VectorXd& state_;
  Eigen::Index next_ = 0;
};

// Where what is told stands in the error state: all but the intrinsics and the scale.
std::vector<int> told_errors(const State& state) {
  std::vector<int> told;
  for (int i = 0; i < state.dimension(); ++i) {
    const int within = i - state.intrinsics_offset();
    const bool intrinsics =
        state.intrinsics_offset() >= 0 && within >= 0 && within < kIntrinsicsSize;
    if (!intrinsics && i != State::kScale) told.push_back(i);
  }
  return told;
}

}  // namespace

FilterSnapshot snapshot_of(const State& state) {
  const ImuState& imu = state.imu();
  FilterSnapshot out;
  out.stamp_ns = imu.stamp_ns;
  out.state.resize(
      static_cast<Eigen::Index>(24 + 7 * state.clones().size() + 3 * state.landmarks().size()));
  StateWriter writer(out.state);
  writer << imu.pose.p_world_imu << imu.v_world_imu << imu.pose.q_world_imu << imu.gyro_bias
         << imu.accel_bias;
  const CameraExtrinsics& extrinsics = state.extrinsics();
  writer << extrinsics.p_imu_cam << extrinsics.q_imu_cam << extrinsics.time_offset_s;
  for (const Clone& clone : state.clones())
    writer << clone.pose.p_world_imu << clone.pose.q_world_imu;
  for (const SlamLandmark& landmark : state.landmarks()) {
    writer << landmark.inverse_depth;
    out.landmark_tracks.push_back(landmark.track_id);
    out.landmark_anchors.push_back(static_cast<std::uint8_t>(state.find_clone(landmark.anchor_id)));
  }
  const Eigen::MatrixXd covariance = state.metric_covariance(state.dimension());
  const std::vector<int> told = told_errors(state);
  out.covariance = covariance(told, told);
  return out;
}

}  // namespace covey
