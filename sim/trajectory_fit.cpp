// SPDX-License-Identifier: Apache-2.0
//
// Splines through given poses: least squares with a penalty on jerk, for position and attitude
// alike.
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "estimator/so3.h"
#include "sim/bspline.h"
#include "sim/trajectory.h"

namespace covey {
namespace {

constexpr int kOrder = Trajectory::kOrder;
constexpr double kGravity = 9.81;  // m/s2
// Control point i acts most around knot i - 2: two of them lie before the start, three after the
// end.
constexpr int kLead = 2;
constexpr int kDifference = 3;  // order of the differences that are penalised: jerk

using Columns = Eigen::MatrixX3d;

// The normal equations of min |B x - r|^2 + penalty |D x + e|^2: B samples the spline at the given
// times, D takes third differences of its control points.
class SplineFit {
 public:
  SplineFit(const std::vector<double>& times_s, double knot_interval_s, std::size_t control_count,
            double penalty)
      : penalty_(penalty),
        samples_(static_cast<Eigen::Index>(times_s.size()), count(control_count)),
        differences_(count(control_count) - kDifference, count(control_count)) {
    fill_samples(times_s, knot_interval_s);
    fill_differences();
    const Eigen::SparseMatrix<double> normal =
        Eigen::SparseMatrix<double>(samples_.transpose() * samples_) +
        penalty_ * Eigen::SparseMatrix<double>(differences_.transpose() * differences_);
    solver_.compute(normal);
    if (solver_.info() != Eigen::Success) {
      throw std::runtime_error("trajectory: spline fit is singular; give more poses");
    }
  }

  // Change of the control points that answers the residuals at the times and the differences.
  [[nodiscard]] Columns solve(const Columns& residuals, const Columns& differences) const {
    return solver_.solve(samples_.transpose() * residuals -
                         penalty_ * (differences_.transpose() * differences));
  }

 private:
  static Eigen::Index count(std::size_t n) { return static_cast<Eigen::Index>(n); }

  void fill_samples(const std::vector<double>& times_s, double knot_interval_s) {
    const double last = static_cast<double>(samples_.cols() - kOrder);
    samples_.reserve(Eigen::VectorXi::Constant(samples_.rows(), kOrder));
    for (std::size_t k = 0; k < times_s.size(); ++k) {
      const double knots = times_s[k] / knot_interval_s;
      const double first = std::clamp(std::floor(knots), 0.0, last);
      const bspline::Weights w = bspline::cumulative_weights(knots - first, knot_interval_s);
      for (int j = 0; j < kOrder; ++j) {
        const double next = j + 1 < kOrder ? w.value[j + 1] : 0.0;
        samples_.insert(count(k), static_cast<Eigen::Index>(first) + j) = w.value[j] - next;
      }
    }
  }

  void fill_differences() {
    differences_.reserve(Eigen::VectorXi::Constant(differences_.rows(), kDifference + 1));
    for (Eigen::Index i = 0; i < differences_.rows(); ++i) {
      differences_.insert(i, i) = -1;
      differences_.insert(i, i + 1) = 3;
      differences_.insert(i, i + 2) = -3;
      differences_.insert(i, i + 3) = 1;
    }
  }

  double penalty_;
  Eigen::SparseMatrix<double, Eigen::RowMajor> samples_, differences_;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver_;
};

std::size_t control_count(double duration_s, double knot_interval_s) {
  const double intervals = std::ceil(duration_s / knot_interval_s - 1e-9);
  return static_cast<std::size_t>(std::max(1.0, intervals)) + kOrder - 1;
}

// Third differences of control points that lie `steps` apart: second differences of the steps.
Columns second_differences(const std::vector<Eigen::Vector3d>& steps) {
  Columns result(static_cast<Eigen::Index>(steps.size()) - 2, 3);
  for (std::size_t i = 0; i + 2 < steps.size(); ++i) {
    result.row(static_cast<Eigen::Index>(i)) =
        (steps[i + 2] - 2 * steps[i + 1] + steps[i]).transpose();
  }
  return result;
}

std::vector<Eigen::Vector3d> fit_positions(const SplineFit& fit,
                                           const std::vector<Eigen::Vector3d>& data,
                                           std::size_t controls) {
  // Relative to the first position: the solution does not lose digits far away from the origin.
  const Eigen::Vector3d& origin = data.front();
  Columns residuals(static_cast<Eigen::Index>(data.size()), 3);
  for (std::size_t k = 0; k < data.size(); ++k) {
    residuals.row(static_cast<Eigen::Index>(k)) = (data[k] - origin).transpose();
  }
  const Columns flat = Columns::Zero(static_cast<Eigen::Index>(controls) - kDifference, 3);
  const Columns solution = fit.solve(residuals, flat);
  std::vector<Eigen::Vector3d> result(controls);
  for (std::size_t i = 0; i < controls; ++i) {
    result[i] = origin + solution.row(static_cast<Eigen::Index>(i)).transpose();
  }
  return result;
}

// The attitude whose time is nearest to each control point's: where the fit starts.
std::vector<Eigen::Quaterniond> nearest_attitudes(const std::vector<double>& times_s,
                                                  const std::vector<Eigen::Quaterniond>& data,
                                                  double knot_interval_s, std::size_t controls) {
  std::vector<Eigen::Quaterniond> result;
  result.reserve(controls);
  for (std::size_t i = 0; i < controls; ++i) {
    const double time = (static_cast<double>(i) - kLead) * knot_interval_s;
    const auto after = std::lower_bound(times_s.begin(), times_s.end(), time);
    const auto index = static_cast<std::size_t>(after - times_s.begin());
    result.push_back(data[std::min(index, data.size() - 1)]);
  }
  return result;
}

// Gauss-Newton in the tangent spaces of the control points. The rotation between neighbouring
// control points is neglected in the Jacobian, not in the residual: a few more rounds, the same
// answer.
std::vector<Eigen::Quaterniond> fit_attitudes(const SplineFit& fit,
                                              const std::vector<double>& times_s,
                                              const std::vector<Eigen::Quaterniond>& data,
                                              double knot_interval_s, std::size_t controls) {
  constexpr int kMaxRounds = 30;
  constexpr double kConverged = 1e-8;  // rad
  std::vector<Eigen::Quaterniond> attitudes =
      nearest_attitudes(times_s, data, knot_interval_s, controls);
  const std::vector<Eigen::Vector3d> no_positions(controls, Eigen::Vector3d::Zero());
  for (int round = 0; round < kMaxRounds; ++round) {
    const Trajectory current(knot_interval_s, no_positions, attitudes);
    Columns residuals(static_cast<Eigen::Index>(data.size()), 3);
    for (std::size_t k = 0; k < data.size(); ++k) {
      const Eigen::Quaterniond q = current.pose_at(times_s[k]).q_world_imu;
      residuals.row(static_cast<Eigen::Index>(k)) =
          log_quaternion(q.conjugate() * data[k]).transpose();
    }
    std::vector<Eigen::Vector3d> steps;
    for (std::size_t i = 0; i + 1 < controls; ++i) {
      steps.push_back(log_quaternion(attitudes[i].conjugate() * attitudes[i + 1]));
    }
    const Columns change = fit.solve(residuals, second_differences(steps));
    for (std::size_t i = 0; i < controls; ++i) {
      const Eigen::Vector3d turn = change.row(static_cast<Eigen::Index>(i)).transpose();
      attitudes[i] = (attitudes[i] * exp_quaternion(turn)).normalized();
    }
    if (change.cwiseAbs().maxCoeff() < kConverged) break;
  }
  return attitudes;
}

// Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors" (2011).
Eigen::Quaterniond flat_attitude(const Eigen::Vector3d& a_world, double yaw) {
  const Eigen::Vector3d z = (a_world + Eigen::Vector3d(0, 0, kGravity)).normalized();
  const Eigen::Vector3d y = z.cross(Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0)).normalized();
  Eigen::Matrix3d R_world_imu;
  R_world_imu << y.cross(z), y, z;
  return Eigen::Quaterniond(R_world_imu);
}

void check_recording(const std::vector<double>& times_s, const std::vector<Pose>& poses) {
  const std::string what = "recorded trajectory: ";
  if (times_s.size() != poses.size() || times_s.size() < static_cast<std::size_t>(kOrder)) {
    throw std::runtime_error(what + "needs one time for each pose, and at least 6 poses");
  }
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::string where = what + "pose " + std::to_string(i) + " ";
    if (!std::isfinite(times_s[i]) || (i > 0 && times_s[i] <= times_s[i - 1])) {
      throw std::runtime_error(where + "is not later than the one before; sort the recording");
    }
    if (!poses[i].p_world_imu.allFinite() || !poses[i].q_world_imu.coeffs().allFinite()) {
      throw std::runtime_error(where + "is not finite");
    }
    if (std::abs(poses[i].q_world_imu.norm() - 1) > 1e-2) {
      throw std::runtime_error(where + "has a quaternion that is not of unit length");
    }
  }
}

}  // namespace

Trajectory Trajectory::from_poses(const std::vector<double>& times_s,
                                  const std::vector<Pose>& poses, double knot_interval_s) {
  constexpr double kPenalty = 1e-4;
  check_recording(times_s, poses);
  std::vector<double> times;
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Quaterniond> attitudes;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    times.push_back(times_s[i] - times_s.front());
    positions.push_back(poses[i].p_world_imu);
    attitudes.push_back(poses[i].q_world_imu.normalized());
  }
  const std::size_t controls = control_count(times.back(), knot_interval_s);
  const SplineFit fit(times, knot_interval_s, controls, kPenalty);
  return Trajectory(knot_interval_s, fit_positions(fit, positions, controls),
                    fit_attitudes(fit, times, attitudes, knot_interval_s, controls))
      .first_seconds(times.back());
}

Trajectory Trajectory::multirotor(const FlatPath& path, double duration_s, double knot_interval_s) {
  constexpr double kPenalty = 1e-6;
  const std::size_t controls = control_count(duration_s, knot_interval_s);
  std::vector<Eigen::Vector3d> positions;
  for (std::size_t i = 0; i < controls; ++i) {
    positions.push_back(path((static_cast<double>(i) - kLead) * knot_interval_s).p_world_imu);
  }
  const std::vector<Eigen::Quaterniond> level(controls, Eigen::Quaterniond::Identity());
  const Trajectory untilted(knot_interval_s, positions, level);

  std::vector<double> times;
  std::vector<Eigen::Quaterniond> attitudes;
  const auto samples =
      2 * static_cast<std::size_t>(std::lround(untilted.duration_s() / knot_interval_s));
  for (std::size_t k = 0; k <= samples; ++k) {
    times.push_back(static_cast<double>(k) * knot_interval_s / 2);
    attitudes.push_back(
        flat_attitude(untilted.at(times.back()).a_world_imu, path(times.back()).yaw));
  }
  const SplineFit fit(times, knot_interval_s, controls, kPenalty);
  return Trajectory(knot_interval_s, positions,
                    fit_attitudes(fit, times, attitudes, knot_interval_s, controls))
      .first_seconds(duration_s);
}

}  // namespace covey
