// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluation.h"

#include <spdlog/fmt/fmt.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <string>
#include <tuple>

#include "estimator/so3.h"

namespace covey {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
// A stretch counts when its length is this close to the one asked for.
constexpr double kStretchTolerance = 0.2;
constexpr TimeNs kSameStampNs = 1000;  // TUM files carry stamps as decimal seconds

constexpr std::size_t kFewestPairs = 3;  // below, an alignment fits anything

// "from 12.000 s to 34.000 s"
std::string span(const StampedPoses& trajectory) {
  if (trajectory.empty()) return "nowhere (it is empty)";
  char text[96];
  std::snprintf(text, sizeof text, "from %.3f s to %.3f s",
                seconds_between(0, trajectory.front().stamp_ns),
                seconds_between(0, trajectory.back().stamp_ns));
  return text;
}

bool stamp_less(const StampedPose& pose, TimeNs stamp_ns) { return pose.stamp_ns < stamp_ns; }

std::vector<PosePair> associate_interpolated(const StampedPoses& estimate,
                                             const StampedPoses& truth, double max_gap_s) {
  std::vector<PosePair> pairs;
  for (const StampedPose& pose : estimate) {
    const auto after = std::lower_bound(truth.begin(), truth.end(), pose.stamp_ns, stamp_less);
    if (after == truth.end()) break;
    if (after->stamp_ns == pose.stamp_ns) {
      pairs.push_back({pose.stamp_ns, pose.pose, after->pose});
      continue;
    }
    if (after == truth.begin()) continue;
    const StampedPose& before = *(after - 1);
    const double gap_s = seconds_between(before.stamp_ns, after->stamp_ns);
    if (gap_s > max_gap_s) continue;
    const double t = seconds_between(before.stamp_ns, pose.stamp_ns) / gap_s;
    const Eigen::Vector3d p =
        before.pose.p_world_imu + t * (after->pose.p_world_imu - before.pose.p_world_imu);
    const Eigen::Quaterniond q = before.pose.q_world_imu.slerp(t, after->pose.q_world_imu);
    pairs.push_back({pose.stamp_ns, pose.pose, {p, q}});
  }
  return pairs;
}

// Poses of the estimate between the first and the last of the truth.
std::size_t within(const StampedPoses& estimate, const StampedPoses& truth) {
  if (truth.empty()) return 0;
  return static_cast<std::size_t>(
      std::count_if(estimate.begin(), estimate.end(), [&](const StampedPose& pose) {
        return pose.stamp_ns >= truth.front().stamp_ns && pose.stamp_ns <= truth.back().stamp_ns;
      }));
}

// The closest stamps find each other first, and each is used once.
std::vector<PosePair> associate_nearest(const StampedPoses& estimate, const StampedPoses& truth,
                                        double max_difference_s) {
  std::vector<std::tuple<TimeNs, std::size_t, std::size_t>> candidates;
  const TimeNs reach_ns = nanoseconds(max_difference_s);
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const TimeNs stamp_ns = estimate[i].stamp_ns;
    auto match = std::lower_bound(truth.begin(), truth.end(), stamp_ns - reach_ns, stamp_less);
    for (; match != truth.end() && match->stamp_ns <= stamp_ns + reach_ns; ++match) {
      const TimeNs difference_ns = std::abs(match->stamp_ns - stamp_ns);
      if (difference_ns >= reach_ns) continue;
      candidates.emplace_back(difference_ns, i, static_cast<std::size_t>(match - truth.begin()));
    }
  }
  std::sort(candidates.begin(), candidates.end());
  constexpr std::size_t kFree = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> partner(estimate.size(), kFree);
  std::vector<bool> taken(truth.size(), false);
  for (const auto& [difference_ns, i, j] : candidates) {
    if (partner[i] != kFree || taken[j]) continue;
    partner[i] = j;
    taken[j] = true;
  }
  std::vector<PosePair> pairs;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    if (partner[i] == kFree) continue;
    pairs.push_back({estimate[i].stamp_ns, estimate[i].pose, truth[partner[i]].pose});
  }
  return pairs;
}

// Sums over all positions, about their means; 1/n as Umeyama has them.
struct Moments {
  Eigen::Vector3d mean_estimate = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_truth = Eigen::Vector3d::Zero();
  Eigen::Matrix3d truth_estimate = Eigen::Matrix3d::Zero();  // of (truth)(estimate)^T
  double variance_estimate = 0;
};

Moments moments(const std::vector<PosePair>& pairs) {
  Moments m;
  const double weight = 1.0 / static_cast<double>(pairs.size());
  for (const PosePair& pair : pairs) {
    m.mean_estimate += weight * pair.estimate.p_world_imu;
    m.mean_truth += weight * pair.truth.p_world_imu;
  }
  for (const PosePair& pair : pairs) {
    const Eigen::Vector3d estimate = pair.estimate.p_world_imu - m.mean_estimate;
    const Eigen::Vector3d truth = pair.truth.p_world_imu - m.mean_truth;
    m.truth_estimate += weight * truth * estimate.transpose();
    m.variance_estimate += weight * estimate.squaredNorm();
  }
  return m;
}

// Umeyama, PAMI 1991, eq. 40..42.
Similarity umeyama(const Moments& m, bool with_scale) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m.truth_estimate,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign.z() = -1;
  Similarity similarity;
  similarity.R_truth_estimate = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  // An estimate that never moves has no scale.
  if (with_scale && m.variance_estimate > 0) {
    similarity.scale = svd.singularValues().dot(sign) / m.variance_estimate;
  }
  return similarity;
}

double rotation_error_deg(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return log_quaternion(a.conjugate() * b).norm() * kDegrees;
}

// The end of each stretch that starts at an index; the size of `positions_along` for "none".
// `positions_along`: distance or time along the trajectory, never decreasing.
std::vector<std::size_t> stretch_ends(const std::vector<double>& positions_along, double length) {
  std::vector<std::size_t> ends;
  for (const double start : positions_along) {
    const double goal = start + length;
    auto end = std::lower_bound(positions_along.begin(), positions_along.end(), goal);
    if (end != positions_along.begin() &&
        (end == positions_along.end() || goal - *(end - 1) < *end - goal)) {
      --end;
    }
    const bool close = std::abs(*end - goal) <= kStretchTolerance * length && *end > start;
    ends.push_back(close ? static_cast<std::size_t>(end - positions_along.begin())
                         : positions_along.size());
  }
  return ends;
}

std::optional<RelativeError> relative_error(const std::vector<PosePair>& pairs,
                                            const std::vector<double>& positions_along,
                                            double length) {
  const std::vector<std::size_t> ends = stretch_ends(positions_along, length);
  std::vector<double> position_errors_m;
  std::vector<double> rotation_errors_deg;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (ends[i] >= pairs.size()) continue;
    const PosePair& a = pairs[i];
    const PosePair& b = pairs[ends[i]];
    const Eigen::Vector3d estimated_motion =
        a.estimate.q_world_imu.conjugate() * (b.estimate.p_world_imu - a.estimate.p_world_imu);
    const Eigen::Vector3d true_motion =
        a.truth.q_world_imu.conjugate() * (b.truth.p_world_imu - a.truth.p_world_imu);
    position_errors_m.push_back((estimated_motion - true_motion).norm());
    rotation_errors_deg.push_back(
        rotation_error_deg(a.estimate.q_world_imu.conjugate() * b.estimate.q_world_imu,
                           a.truth.q_world_imu.conjugate() * b.truth.q_world_imu));
  }
  if (position_errors_m.empty()) return std::nullopt;
  RelativeError error;
  error.length = length;
  error.stretches = static_cast<int>(position_errors_m.size());
  error.position_m = statistics(position_errors_m);
  error.rotation_deg = statistics(rotation_errors_deg);
  return error;
}

// e^T C^-1 e
double normalized_squared(const Eigen::Vector3d& error, const Eigen::Matrix3d& covariance,
                          TimeNs stamp_ns) {
  const Eigen::LLT<Eigen::Matrix3d> llt(covariance);
  if (llt.info() != Eigen::Success) {
    throw std::runtime_error("the covariance at stamp " + std::to_string(stamp_ns) +
                             " ns is not positive definite");
  }
  return error.dot(llt.solve(error));
}

}  // namespace

std::vector<PosePair> associate(const StampedPoses& estimate, const StampedPoses& truth,
                                const AssociationOptions& options) {
  std::vector<PosePair> pairs = options.method == Association::kNearest
                                    ? associate_nearest(estimate, truth, options.max_difference_s)
                                    : associate_interpolated(estimate, truth, options.max_gap_s);
  if (pairs.size() >= kFewestPairs) return pairs;
  const std::string only = fmt::format("only {} poses match in time: ", pairs.size());
  if (options.method == Association::kInterpolate && within(estimate, truth) >= kFewestPairs) {
    throw std::runtime_error(
        only + fmt::format("states of the ground truth are more than {} s apart (covey evaluate "
                           "--max-gap says how far apart they may be)",
                           options.max_gap_s));
  }
  throw std::runtime_error(only + "the estimate runs " + span(estimate) + ", the ground truth " +
                           span(truth) + ": are both on one clock?");
}

Similarity align(const std::vector<PosePair>& pairs, Alignment alignment) {
  if (alignment == Alignment::kNone || pairs.empty()) return {};
  const Moments m = moments(pairs);
  Similarity similarity;
  if (alignment == Alignment::kPosYaw) {
    similarity.R_truth_estimate =
        Eigen::AngleAxisd(nearest_yaw(m.truth_estimate), Eigen::Vector3d::UnitZ())
            .toRotationMatrix();
  } else {
    similarity = umeyama(m, alignment == Alignment::kSim3);
  }
  similarity.t_truth_estimate =
      m.mean_truth - similarity.scale * (similarity.R_truth_estimate * m.mean_estimate);
  return similarity;
}

Pose transform(const Similarity& similarity, const Pose& estimate) {
  return {similarity.scale * (similarity.R_truth_estimate * estimate.p_world_imu) +
              similarity.t_truth_estimate,
          Eigen::Quaterniond(similarity.R_truth_estimate) * estimate.q_world_imu};
}

ErrorStatistics statistics(const std::vector<double>& errors) {
  if (errors.empty()) return {};
  const double count = static_cast<double>(errors.size());
  ErrorStatistics result;
  double sum = 0;
  double sum_of_squares = 0;
  for (const double error : errors) {
    sum += error;
    sum_of_squares += error * error;
    result.max = std::max(result.max, error);
  }
  result.mean = sum / count;
  result.rmse = std::sqrt(sum_of_squares / count);
  double variance = 0;
  for (const double error : errors) variance += (error - result.mean) * (error - result.mean);
  result.std = std::sqrt(variance / count);
  return result;
}

AbsoluteError absolute_error(const std::vector<PosePair>& pairs, Alignment alignment) {
  const Similarity similarity = align(pairs, alignment);
  std::vector<double> position_errors_m;
  std::vector<double> rotation_errors_deg;
  for (const PosePair& pair : pairs) {
    const Pose aligned = transform(similarity, pair.estimate);
    position_errors_m.push_back((pair.truth.p_world_imu - aligned.p_world_imu).norm());
    rotation_errors_deg.push_back(rotation_error_deg(aligned.q_world_imu, pair.truth.q_world_imu));
  }
  return {statistics(position_errors_m), statistics(rotation_errors_deg), similarity.scale};
}

std::optional<RelativeError> relative_error_over_distance(const std::vector<PosePair>& pairs,
                                                          double distance_m) {
  std::vector<double> travelled_m;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double step_m =
        i == 0 ? 0 : (pairs[i].truth.p_world_imu - pairs[i - 1].truth.p_world_imu).norm();
    travelled_m.push_back((i == 0 ? 0 : travelled_m.back()) + step_m);
  }
  return relative_error(pairs, travelled_m, distance_m);
}

std::optional<RelativeError> relative_error_over_time(const std::vector<PosePair>& pairs,
                                                      double interval_s) {
  std::vector<double> elapsed_s;
  elapsed_s.reserve(pairs.size());
  for (const PosePair& pair : pairs) {
    elapsed_s.push_back(seconds_between(pairs.front().stamp_ns, pair.stamp_ns));
  }
  return relative_error(pairs, elapsed_s, interval_s);
}

PoseError pose_error(const PosePair& pair) {
  return {pair.truth.p_world_imu - pair.estimate.p_world_imu,
          log_quaternion(pair.estimate.q_world_imu.conjugate() * pair.truth.q_world_imu)};
}

std::optional<Nees> nees(const std::vector<PosePair>& pairs,
                         const std::vector<StampedCovariance>& covariances) {
  Nees sums;
  auto sample = covariances.begin();
  for (const PosePair& pair : pairs) {
    sample = std::lower_bound(sample, covariances.end(), pair.stamp_ns - kSameStampNs,
                              [](const StampedCovariance& covariance, TimeNs stamp_ns) {
                                return covariance.stamp_ns < stamp_ns;
                              });
    if (sample == covariances.end()) break;
    if (sample->stamp_ns > pair.stamp_ns + kSameStampNs) continue;
    const PoseError error = pose_error(pair);
    sums.position += normalized_squared(error.position_world,
                                        sample->covariance.topLeftCorner<3, 3>(), sample->stamp_ns);
    sums.orientation += normalized_squared(
        error.rotation_imu, sample->covariance.bottomRightCorner<3, 3>(), sample->stamp_ns);
    ++sums.samples;
  }
  if (sums.samples == 0) return std::nullopt;
  return Nees{sums.samples, sums.position / sums.samples, sums.orientation / sums.samples};
}

double path_length_m(const StampedPoses& trajectory) {
  double length_m = 0;
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    length_m += (trajectory[i].pose.p_world_imu - trajectory[i - 1].pose.p_world_imu).norm();
  }
  return length_m;
}

double path_length_m(const std::vector<PosePair>& pairs) {
  double length_m = 0;
  for (std::size_t i = 1; i < pairs.size(); ++i) {
    length_m += (pairs[i].truth.p_world_imu - pairs[i - 1].truth.p_world_imu).norm();
  }
  return length_m;
}

}  // namespace covey
