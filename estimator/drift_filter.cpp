// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "estimator/chi_square.h"
#include "estimator/drift_observation.h"
#include "estimator/drift_step.h"
#include "estimator/positive_definite.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr int kSize = DriftState::kSize;
constexpr int kNewAtOnce = 4;  // keyframes of one relative pose
// Relative poses of one drone: what is here already, and its answer.
constexpr int kMostPerKeyframe = 2;
// How uncertain a world is taken to be that a few relative poses have aligned.
constexpr double kAlignedSigma_m = 1.0, kAlignedSigma_rad = 0.1;

// Share of the variance of odometry's scale over a way that depths measured on it do not have: they
// come from some of it more than from the rest (simulated features: 0.1 to 0.5).
constexpr double kUnsharedScale = 0.25;
// Of a relative pose and the ratio of depths.
constexpr int kRows = kSize + 1;

bool makes_sense(const KeyframePose& keyframe) {
  return keyframe.T_world_cam.matrix().allFinite() && is_positive_definite<6>(keyframe.covariance);
}

bool makes_sense(const RelativePose& measurement) {
  if (!makes_sense(measurement.own) || !makes_sense(measurement.own_before) ||
      !makes_sense(measurement.other) || !makes_sense(measurement.other_before) ||
      !measurement.T_other_own.matrix().allFinite() ||
      !is_positive_definite<6>(measurement.covariance)) {
    return false;
  }
  const std::optional<DepthRatio>& ratio = measurement.depth_ratio;
  return !ratio ||
         (std::isfinite(ratio->log_ratio) &&
          is_positive_definite<kRows>(noise_of(measurement, &*ratio, Eigen::Matrix3d::Identity())));
}

// Of a level world, [dp dtheta].
Matrix6d about_pivot(double position_sigma_m, double yaw_sigma) {
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(position_sigma_m * position_sigma_m);
  covariance(5, 5) = yaw_sigma * yaw_sigma;
  return covariance;
}

// Is the way such that depths measured over it are as wrong as it is?
bool measures_depths(const KeyframePose& from, const KeyframePose& to, double least_s) {
  return seconds_between(from.stamp_ns, to.stamp_ns) >= least_s &&
         is_depth_baseline(from.T_world_cam.translation(), to.T_world_cam.translation());
}

}  // namespace

DriftFilter::DriftFilter(const DriftConfig& config, std::string own_name)
    : config_(config),
      gate_limit_(chi_square_quantile(config.gate_confidence, kSize)),
      gate_limit_with_ratio_(chi_square_quantile(config.gate_confidence, kRows)),
      claims_(config.claims) {
  drones_.push_back({std::move(own_name), {}, {}, {}, 0});
  drones_.front().world.known = true;
}

DriftFilter::Drone DriftFilter::newcomer(const std::string& name) const {
  Drone drone{name, {}, {}, {}, 0};
  drone.world.known = config_.common_start;
  if (config_.common_start) {
    drone.world.pivot = p_own_start_.value_or(Eigen::Vector3d::Zero());
    drone.world.covariance = about_pivot(config_.start_position_sigma_m, config_.start_yaw_sigma);
  }
  return drone;
}

std::optional<std::size_t> DriftFilter::drone_index(const std::string& name) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    if (drones_[i].name == name) return i;
  }
  if (drones_.size() >= static_cast<std::size_t>(config_.max_drones)) return std::nullopt;
  drones_.push_back(newcomer(name));
  return drones_.size() - 1;
}

void DriftFilter::add_own(const KeyframePose& pose) {
  if (!p_own_start_) p_own_start_ = pose.T_world_cam.translation();
  claims_.add_own(pose);
}

DriftState::Node DriftFilter::to_node(std::size_t drone, const KeyframePose& pose) const {
  const World& world = drones_[drone].world;
  const Eigen::Isometry3d T_world_cam = world.T_own_peer * pose.T_world_cam;
  DriftState::Node node{
      drone,
      pose.keyframe_id,
      pose.stamp_ns,
      T_world_cam.translation(),
      T_world_cam.linear(),
      rotated(drone == 0 ? pose.covariance : claims_.believable(pose), world.T_own_peer.linear())};
  const Matrix6d F = drift_lever(world.pivot, node.p);
  node.covariance += F * world.covariance * F.transpose();
  return node;
}

bool DriftFilter::is_of_present_flight(std::size_t drone, const KeyframePose& keyframe) {
  if (drone == 0) return true;
  bool starts_anew = false;
  for (const DriftState::Node& known : state_.nodes()) {
    if (known.drone != drone || are_of_one_flight(known, keyframe)) continue;
    if (keyframe.stamp_ns <= known.stamp_ns) return false;
    starts_anew = true;
  }
  if (starts_anew) forget_drone(drones_[drone].name);
  return true;
}

void DriftFilter::forget_drone(const std::string& peer) {
  for (std::size_t drone = 1; drone < drones_.size(); ++drone) {
    if (drones_[drone].name != peer) continue;
    for (int i = keyframes() - 1; i >= 0; --i) {
      if (state_.node(i).drone == drone) state_.forget(i);
    }
    drones_[drone] = newcomer(drones_[drone].name);
  }
}

DriftOutcome DriftFilter::add(const RelativePose& measurement) {
  if (!makes_sense(measurement)) return DriftOutcome::kInvalid;
  const std::optional<std::size_t> index = drone_index(measurement.drone);
  if (!index || !is_of_present_flight(*index, measurement.other)) return DriftOutcome::kInvalid;
  Drone& drone = drones_[*index];
  if (drone.world.known) {
    const DriftOutcome outcome = use(*index, measurement);
    if (outcome == DriftOutcome::kUsed) drone.vote = {};
    return outcome == DriftOutcome::kGated ? contradict(*index, measurement) : outcome;
  }
  const std::vector<RelativePose> agreeing = drone.vote.add(config_.alignment, measurement);
  if (agreeing.empty()) return DriftOutcome::kUnaligned;
  return align(*index, agreeing) ? DriftOutcome::kUsed : DriftOutcome::kGated;
}

DriftOutcome DriftFilter::contradict(std::size_t drone, const RelativePose& measurement) {
  const int moves = drones_[drone].moves;
  if (drone == 0 || moves >= config_.max_moves) return DriftOutcome::kGated;
  const std::vector<RelativePose> agreeing =
      drones_[drone].vote.add(config_.alignment, measurement);
  if (agreeing.empty()) return DriftOutcome::kGated;
  forget_drone(measurement.drone);
  drones_[drone].moves = moves + 1;
  return align(drone, agreeing) ? DriftOutcome::kMoved : DriftOutcome::kGated;
}

bool DriftFilter::align(std::size_t drone, const std::vector<RelativePose>& agreeing) {
  const RelativePose& newest = agreeing.back();
  World& world = drones_[drone].world;
  world.known = true;
  world.pivot = newest.own.T_world_cam.translation();
  world.T_own_peer = levelled(world_of(newest), newest.other.T_world_cam.translation());
  world.covariance = about_pivot(kAlignedSigma_m, kAlignedSigma_rad);
  bool used = false;
  for (const RelativePose& relative : agreeing) {
    used |= use(drone, relative) == DriftOutcome::kUsed;
  }
  if (!used) world = newcomer(newest.drone).world;
  return used;
}

DriftFilter::UsedPose DriftFilter::to_used(const RelativePose& measurement) {
  const bool by_other = measurement.found_by_other;
  const KeyframePose& seen = by_other ? measurement.own : measurement.other;
  const KeyframePose& finder = by_other ? measurement.other : measurement.own;
  return {by_other, seen.keyframe_id, finder.stamp_ns, measurement.own.stamp_ns};
}

// As for a long row of measurements whose errors are correlated: one, and twice the sum of the
// correlations with those before.
double DriftFilter::repetition(const Drone& drone, const UsedPose& pose) const {
  double factor = 1;
  for (const UsedPose& known : drone.used) {
    if (known.found_by_other != pose.found_by_other) continue;
    const bool same = known.landmarks_of == pose.landmarks_of;
    const double apart_s = std::abs(seconds_between(known.found_ns, pose.found_ns));
    factor += 2 * (same ? 1 : config_.other_landmarks_share) *
              std::exp(-apart_s / config_.same_landmarks_s);
  }
  return factor;
}

// However often a peer answers, it sees the same corners: their errors do not average out. The same
// keyframe in the same image is the same measurement, remembered or sent once more.
bool DriftFilter::said_enough(const Drone& drone, const UsedPose& pose) const {
  const bool said = std::any_of(drone.used.begin(), drone.used.end(), [&](const UsedPose& used) {
    return used.found_by_other == pose.found_by_other && used.landmarks_of == pose.landmarks_of &&
           used.found_ns == pose.found_ns && used.own_stamp_ns == pose.own_stamp_ns;
  });
  if (said) return true;
  const auto known = std::count_if(drone.used.begin(), drone.used.end(), [&](const UsedPose& used) {
    return used.found_by_other == pose.found_by_other && used.own_stamp_ns == pose.own_stamp_ns;
  });
  if (known > 0) return known >= kMostPerKeyframe;
  const bool full = drone.used.size() >= static_cast<std::size_t>(config_.max_keyframes);
  return full && pose.own_stamp_ns < drone.used.front().own_stamp_ns;
}

void DriftFilter::count_used(Drone& drone, const UsedPose& pose) {
  drone.used.push_back(pose);
  if (drone.used.size() > static_cast<std::size_t>(config_.max_keyframes)) drone.used.pop_front();
}

double DriftFilter::unshared_scale_variance(const DriftState::Node& from,
                                            const DriftState::Node& to) {
  const Eigen::RowVector3d s = scale_gradient(from.p, to.p);
  if (s.isZero()) return 0;
  const DriftStep step = drift_step(from.p, from.covariance, to.p, to.covariance);
  return kUnsharedScale * s * step.Q.topLeftCorner<3, 3>() * s.transpose();
}

const DepthRatio* DriftFilter::usable_ratio(const RelativePose& measurement) const {
  const double least_s = config_.least_depth_memory_s;
  if (!measurement.depth_ratio ||
      !measures_depths(measurement.own_before, measurement.own, least_s) ||
      !measures_depths(measurement.other_before, measurement.other, least_s)) {
    return nullptr;
  }
  return &*measurement.depth_ratio;
}

DriftFilter::Side DriftFilter::side_of(int at, int before) const {
  const DriftState::Node &from = state_.node(before), &to = state_.node(at);
  return {
      at, before, {to.p, to.R, scale_gradient(from.p, to.p), unshared_scale_variance(from, to)}};
}

// The keyframes since which depths were measured are needed where depths were used: those of what
// was found, and for a ratio both.
DriftFilter::Sides DriftFilter::insert_sides(std::size_t drone, const RelativePose& measurement,
                                             bool with_ratio) {
  const bool by_own_depths = measurement.found_by_other;
  int own_before = -1, other_before = -1;
  const int own = state_.find_or_insert(to_node(0, measurement.own));
  if (with_ratio || by_own_depths) {
    own_before = state_.find_or_insert(to_node(0, measurement.own_before));
  }
  if (with_ratio || !by_own_depths) {
    other_before = state_.find_or_insert(to_node(drone, measurement.other_before));
  }
  const int other = state_.find_or_insert(to_node(drone, measurement.other));
  return {side_of(own, own_before < 0 ? own : own_before),
          side_of(other, other_before < 0 ? other : other_before)};
}

// Whether a relative pose fits shows only once its keyframes are in the state, and for them others
// may have to leave: all of that is undone if it does not fit.
DriftOutcome DriftFilter::use(std::size_t drone, const RelativePose& measurement) {
  const UsedPose pose = to_used(measurement);
  if (said_enough(drones_[drone], pose)) return DriftOutcome::kRepeated;
  state_.save();
  state_.shrink_to(config_.max_keyframes - kNewAtOnce);
  const DriftOutcome outcome =
      fuse(drone, claims_.believable(measurement), repetition(drones_[drone], pose));
  if (outcome == DriftOutcome::kUsed) {
    count_used(drones_[drone], pose);
    claims_.learn_usual(measurement);
  } else {
    state_.restore();
  }
  return outcome;
}

DriftOutcome DriftFilter::fuse(std::size_t drone, const RelativePose& measurement,
                               double repetition) {
  const DepthRatio* ratio = usable_ratio(measurement);
  const auto [own, other] = insert_sides(drone, measurement, ratio != nullptr);
  if (own.at == other.at) return DriftOutcome::kInvalid;
  const DriftObservation observed = observe_drift(own.keyframe, other.keyframe, measurement, ratio);
  const std::array<std::pair<int, Matrix76d>, 4> terms{{{own.at, observed.H_own},
                                                        {own.before, observed.H_own_before},
                                                        {other.at, observed.H_other},
                                                        {other.before, observed.H_other_before}}};

  const auto P = state_.covariance();
  Vector7d r = observed.r;
  Eigen::MatrixXd PHt = Eigen::MatrixXd::Zero(P.rows(), kRows);
  for (const auto& [index, H] : terms) {
    r -= H * state_.error(index);
    PHt.noalias() += P.middleCols<kSize>(DriftState::block(index)) * H.transpose();
  }
  Matrix7d S = repetition * observed.noise;
  for (const auto& [index, H] : terms) S += H * PHt.middleRows<kSize>(DriftState::block(index));
  const Eigen::LLT<Matrix7d> cholesky((S + S.transpose()) / 2);
  if (cholesky.info() != Eigen::Success) return DriftOutcome::kInvalid;
  const double limit = ratio != nullptr ? gate_limit_with_ratio_ : gate_limit_;
  if (!(r.dot(cholesky.solve(r)) <= limit)) return DriftOutcome::kGated;
  state_.correct(cholesky.matrixL().solve(PHt.transpose()), cholesky.matrixL().solve(r));
  return DriftOutcome::kUsed;
}

Odometry DriftFilter::corrected(const Odometry& alone) const {
  const int last = state_.neighbours(0, alone.stamp_ns + 1).earlier;
  if (last < 0) return alone;
  const DriftState::Node& known = state_.node(last);
  return without_drift(alone, known.p, known.covariance, state_.error(last),
                       state_.covariance_of(last));
}

std::optional<WorldAlignment> DriftFilter::alignment(const std::string& peer) const {
  const std::vector<int> known = nodes_of(peer);
  if (known.empty()) return std::nullopt;
  return alignment_by(known.back());
}

std::optional<WorldAlignment> DriftFilter::alignment_at_start(const std::string& peer) const {
  const std::vector<int> known = nodes_of(peer);
  if (known.empty()) return std::nullopt;
  return alignment_by(known.front());
}

std::vector<int> DriftFilter::nodes_of(const std::string& peer) const {
  std::vector<int> indices;
  for (int i = 0; i < keyframes(); ++i) {
    const std::size_t drone = state_.node(i).drone;
    if (drone > 0 && drones_[drone].name == peer) indices.push_back(i);
  }
  std::sort(indices.begin(), indices.end(),
            [&](int a, int b) { return state_.node(a).stamp_ns < state_.node(b).stamp_ns; });
  return indices;
}

WorldAlignment DriftFilter::alignment_by(int index) const {
  const DriftState::Node& known = state_.node(index);
  const auto error = state_.error(index);
  Eigen::Isometry3d correction = Eigen::Isometry3d::Identity();  // about the keyframe
  correction.linear() = exp_so3(error.tail<3>());
  correction.translation() = known.p + error.head<3>() - correction.linear() * known.p;
  const Matrix6d P = state_.covariance_of(index);
  const Eigen::Isometry3d& T_own_peer = drones_[known.drone].world.T_own_peer;
  return {
      correction * T_own_peer, T_own_peer.inverse() * known.p,
      std::sqrt(P.topLeftCorner<3, 3>().selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff()),
      std::sqrt(P(5, 5))};
}

int DriftFilter::moves(const std::string& peer) const {
  const auto drone = std::find_if(drones_.begin(), drones_.end(),
                                  [&](const Drone& known) { return known.name == peer; });
  return drone == drones_.end() ? 0 : drone->moves;
}

std::vector<std::string> DriftFilter::peers() const {
  std::vector<std::string> names;
  for (std::size_t i = 1; i < drones_.size(); ++i) names.push_back(drones_[i].name);
  return names;
}

}  // namespace covey
