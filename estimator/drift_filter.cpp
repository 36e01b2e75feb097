// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <utility>

#include "estimator/chi_square.h"
#include "estimator/drift_observation.h"
#include "estimator/drift_step.h"
#include "estimator/positive_definite.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr int kSize = 6;                    // of one keyframe's error
constexpr int kNewAtOnce = 4;               // keyframes of one relative pose
constexpr std::size_t kMaxHistory = 10000;  // own keyframes
// Relative poses of one drone: what is here already, and its answer.
constexpr int kMostPerKeyframe = 2;
// How uncertain a world is taken to be that a few relative poses have aligned.
constexpr double kAlignedSigma_m = 1.0, kAlignedSigma_rad = 0.1;

// Share of the variance of odometry's scale over a way that depths measured on it do not have: they
// come from some of it more than from the rest (simulated features: 0.1 to 0.5).
constexpr double kUnsharedScale = 0.25;
// Of a relative pose and the ratio of depths.
constexpr int kRows = kSize + 1;

constexpr auto block(int node) { return kSize * node; }

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

struct FoundVariances {
  double position = 0, angle = 0;  // m2 and rad2, sums over the three axes
};

FoundVariances variances_of(const RelativePose& measurement) {
  return {measurement.covariance.topLeftCorner<3, 3>().trace(),
          measurement.covariance.bottomRightCorner<3, 3>().trace()};
}

void enlarge(RelativePose& measurement, double factor) {
  measurement.covariance *= factor;
  if (!measurement.depth_ratio) return;
  measurement.depth_ratio->variance *= factor;
  measurement.depth_ratio->covariance_with_pose *= factor;
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
      gate_limit_with_ratio_(chi_square_quantile(config.gate_confidence, kRows)) {
  drones_.push_back({std::move(own_name), {}, {}, {}, 0});
  drones_.front().world.known = true;
}

DriftFilter::Drone DriftFilter::newcomer(const std::string& name) const {
  Drone drone{name, {}, {}, {}, 0};
  drone.world.known = config_.common_start;
  if (config_.common_start) {
    drone.world.pivot = p_own_start_;
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
  if (own_history_.empty()) p_own_start_ = pose.T_world_cam.translation();
  if (own_history_.size() >= kMaxHistory) own_history_.pop_front();
  own_history_.push_back(
      {pose.stamp_ns, pose.covariance.topLeftCorner<3, 3>().trace(), pose.covariance(5, 5)});
}

// At least a share of what the own odometry had drifted by then: who claims less is not believed.
Matrix6d DriftFilter::believable(const KeyframePose& peer) const {
  const auto after = std::upper_bound(
      own_history_.begin(), own_history_.end(), peer.stamp_ns,
      [](TimeNs stamp_ns, const OwnDrift& own) { return stamp_ns < own.stamp_ns; });
  if (after == own_history_.begin()) return peer.covariance;
  const OwnDrift& own = *std::prev(after);
  const double position = peer.covariance.topLeftCorner<3, 3>().trace();
  const double yaw = peer.covariance(5, 5);
  const double factor = config_.least_claim * std::max(own.position / position, own.yaw / yaw);
  return std::max(1.0, factor) * peer.covariance;
}

RelativePose DriftFilter::believable(RelativePose measurement) const {
  if (!measurement.found_by_other) return measurement;
  const double m = config_.found_position_sigma_m, rad = config_.found_angle_sigma;
  measurement.covariance.diagonal().head<3>().array() += m * m;
  measurement.covariance.diagonal().tail<3>().array() += rad * rad;
  if (usual_found_.count == 0) return measurement;
  const FoundVariances claimed = variances_of(measurement);
  const double factor =
      config_.least_claim * std::max(std::exp(usual_found_.log_position) / claimed.position,
                                     std::exp(usual_found_.log_angle) / claimed.angle);
  enlarge(measurement, std::max(1.0, factor));
  return measurement;
}

void DriftFilter::learn_usual(const RelativePose& found) {
  constexpr int kMemory = 100;
  if (found.found_by_other) return;
  usual_found_.count = std::min(usual_found_.count + 1, kMemory);
  const FoundVariances variances = variances_of(found);
  const double share = 1.0 / usual_found_.count;
  usual_found_.log_position += share * (std::log(variances.position) - usual_found_.log_position);
  usual_found_.log_angle += share * (std::log(variances.angle) - usual_found_.log_angle);
}

DriftFilter::Node DriftFilter::to_node(std::size_t drone, const KeyframePose& pose) const {
  const World& world = drones_[drone].world;
  const Eigen::Isometry3d T_world_cam = world.T_own_peer * pose.T_world_cam;
  Node node{drone,
            pose.keyframe_id,
            pose.stamp_ns,
            T_world_cam.translation(),
            T_world_cam.linear(),
            rotated(drone == 0 ? pose.covariance : believable(pose), world.T_own_peer.linear())};
  const Matrix6d F = drift_lever(world.pivot, node.p);
  node.covariance += F * world.covariance * F.transpose();
  return node;
}

DriftFilter::Neighbours DriftFilter::neighbours(std::size_t drone, TimeNs stamp_ns) const {
  Neighbours found;
  for (int i = 0; i < keyframes(); ++i) {
    const Node& other = node(i);
    if (other.drone != drone || other.stamp_ns == stamp_ns) continue;
    int& best = other.stamp_ns < stamp_ns ? found.earlier : found.later;
    const auto distance = [&](int index) { return std::abs(node(index).stamp_ns - stamp_ns); };
    if (best < 0 || distance(i) < distance(best)) best = i;
  }
  return found;
}

int DriftFilter::find_or_insert(const Node& wanted) {
  for (int i = 0; i < keyframes(); ++i) {
    if (node(i).drone == wanted.drone && node(i).keyframe_id == wanted.keyframe_id) return i;
  }
  const Neighbours near = neighbours(wanted.drone, wanted.stamp_ns);
  // What the earlier one says of it, or only the odometry; then what the later one adds.
  DriftStep from_earlier{Matrix6d::Zero(), wanted.covariance};
  if (near.earlier >= 0) {
    const Node& earlier = node(near.earlier);
    from_earlier = drift_step(earlier.p, earlier.covariance, wanted.p, wanted.covariance);
  }
  Matrix6d from_later = Matrix6d::Zero();
  if (near.later >= 0) {
    const Node& later = node(near.later);
    const DriftStep onward = drift_step(wanted.p, wanted.covariance, later.p, later.covariance);
    const Matrix6d Q = from_earlier.Q;
    const Matrix6d S = onward.A * Q * onward.A.transpose() + onward.Q;
    from_later = S.llt().solve(onward.A * Q).transpose();
    const Matrix6d rest = Matrix6d::Identity() - from_later * onward.A;
    from_earlier.A = rest * from_earlier.A;
    from_earlier.Q = rest * Q * rest.transpose() + from_later * onward.Q * from_later.transpose();
  }
  append(wanted, near, from_earlier.A, from_later, from_earlier.Q);
  return keyframes() - 1;
}

Eigen::Index DriftFilter::size() const { return block(keyframes()); }

void DriftFilter::reserve(Eigen::Index size) {
  if (size <= x_.size()) return;
  const Eigen::Index room = std::max<Eigen::Index>(size, 2 * x_.size());
  x_.conservativeResize(room);
  P_.conservativeResize(room, room);
}

// e = A_earlier e_earlier + A_later e_later + w, cov(w) = Q.
void DriftFilter::append(const Node& node, const Neighbours& from, const Matrix6d& A_earlier,
                         const Matrix6d& A_later, const Matrix6d& Q) {
  const Eigen::Index n = size();
  reserve(n + kSize);
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(kSize, n);
  Vector6d mean = Vector6d::Zero();
  Matrix6d covariance = Q;
  const auto take = [&](int neighbour, const Matrix6d& A) {
    if (neighbour < 0) return;
    cross.noalias() += A * P_.block(block(neighbour), 0, kSize, n);
    mean += A * x_.segment<kSize>(block(neighbour));
  };
  take(from.earlier, A_earlier);
  take(from.later, A_later);
  if (from.earlier >= 0) {
    covariance += cross.middleCols<kSize>(block(from.earlier)) * A_earlier.transpose();
  }
  if (from.later >= 0) {
    covariance += cross.middleCols<kSize>(block(from.later)) * A_later.transpose();
  }
  x_.segment<kSize>(n) = mean;
  P_.block(n, 0, kSize, n) = cross;
  P_.block(0, n, n, kSize) = cross.transpose();
  P_.block<kSize, kSize>(n, n) = (covariance + covariance.transpose()) / 2;
  nodes_.push_back(node);
}

// Forgets the keyframe whose neighbours on its drone's way are closest in time; of each drone the
// first and the last stay, if that is possible.
void DriftFilter::make_room() {
  while (keyframes() + kNewAtOnce > config_.max_keyframes) {
    int closest = 0;
    TimeNs shortest = std::numeric_limits<TimeNs>::max();
    for (int i = 0; i < keyframes(); ++i) {
      const Neighbours near = neighbours(node(i).drone, node(i).stamp_ns);
      if (near.earlier < 0 || near.later < 0) continue;
      const TimeNs span = node(near.later).stamp_ns - node(near.earlier).stamp_ns;
      if (span >= shortest) continue;
      closest = i;
      shortest = span;
    }
    forget(closest);
  }
}

// The last one takes its place.
void DriftFilter::forget(int index) {
  const Eigen::Index n = size(), from = n - kSize, to = block(index);
  if (to != from) {
    nodes_[static_cast<std::size_t>(index)] = nodes_.back();
    x_.segment<kSize>(to) = x_.segment<kSize>(from);
    P_.block(0, to, n, kSize) = P_.block(0, from, n, kSize);
    P_.block(to, 0, kSize, n) = P_.block(from, 0, kSize, n);
  }
  nodes_.pop_back();
}

bool DriftFilter::is_of_present_flight(std::size_t drone, const KeyframePose& keyframe) {
  if (drone == 0) return true;
  bool starts_anew = false;
  for (const Node& known : nodes_) {
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
      if (node(i).drone == drone) forget(i);
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

double DriftFilter::unshared_scale_variance(const Node& from, const Node& to) {
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
  const Node &from = node(before), &to = node(at);
  return {
      at, before, {to.p, to.R, scale_gradient(from.p, to.p), unshared_scale_variance(from, to)}};
}

// The keyframes since which depths were measured are needed where depths were used: those of what
// was found, and for a ratio both.
DriftFilter::Sides DriftFilter::insert_sides(std::size_t drone, const RelativePose& measurement,
                                             bool with_ratio) {
  const bool by_own_depths = measurement.found_by_other;
  int own_before = -1, other_before = -1;
  const int own = find_or_insert(to_node(0, measurement.own));
  if (with_ratio || by_own_depths) {
    own_before = find_or_insert(to_node(0, measurement.own_before));
  }
  if (with_ratio || !by_own_depths) {
    other_before = find_or_insert(to_node(drone, measurement.other_before));
  }
  const int other = find_or_insert(to_node(drone, measurement.other));
  return {side_of(own, own_before < 0 ? own : own_before),
          side_of(other, other_before < 0 ? other : other_before)};
}

void DriftFilter::save() {
  saved_.nodes = nodes_;
  if (saved_.P.rows() != P_.rows()) {
    saved_.x.resize(x_.size());
    saved_.P.resize(P_.rows(), P_.cols());
  }
  saved_.x.head(size()) = x_.head(size());
  saved_.P.topLeftCorner(size(), size()) = P_.topLeftCorner(size(), size());
}

void DriftFilter::restore() {
  nodes_ = saved_.nodes;
  x_.head(size()) = saved_.x.head(size());
  P_.topLeftCorner(size(), size()) = saved_.P.topLeftCorner(size(), size());
}

// Whether a relative pose fits shows only once its keyframes are in the state, and for them others
// may have to leave: all of that is undone if it does not fit.
DriftOutcome DriftFilter::use(std::size_t drone, const RelativePose& measurement) {
  const UsedPose pose = to_used(measurement);
  if (said_enough(drones_[drone], pose)) return DriftOutcome::kRepeated;
  save();
  make_room();
  const DriftOutcome outcome =
      fuse(drone, believable(measurement), repetition(drones_[drone], pose));
  if (outcome == DriftOutcome::kUsed) {
    count_used(drones_[drone], pose);
    learn_usual(measurement);
  } else {
    restore();
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

  auto P = P_.topLeftCorner(size(), size());
  Vector7d r = observed.r;
  Eigen::MatrixXd PHt = Eigen::MatrixXd::Zero(size(), kRows);
  for (const auto& [index, H] : terms) {
    r -= H * x_.segment<kSize>(block(index));
    PHt.noalias() += P.middleCols<kSize>(block(index)) * H.transpose();
  }
  Matrix7d S = repetition * observed.noise;
  for (const auto& [index, H] : terms) S += H * PHt.middleRows<kSize>(block(index));
  const Eigen::LLT<Matrix7d> cholesky((S + S.transpose()) / 2);
  if (cholesky.info() != Eigen::Success) return DriftOutcome::kInvalid;
  const double limit = ratio != nullptr ? gate_limit_with_ratio_ : gate_limit_;
  if (!(r.dot(cholesky.solve(r)) <= limit)) return DriftOutcome::kGated;
  const Eigen::MatrixXd W = cholesky.matrixL().solve(PHt.transpose());  // P H^T inv(S) H P = W^T W
  x_.head(size()) += W.transpose() * cholesky.matrixL().solve(r);
  P.noalias() -= W.transpose() * W;
  return DriftOutcome::kUsed;
}

Odometry DriftFilter::corrected(const Odometry& alone) const {
  const int last = neighbours(0, alone.stamp_ns + 1).earlier;
  if (last < 0) return alone;
  const Node& known = node(last);
  return without_drift(alone, known.p, known.covariance, x_.segment<kSize>(block(last)),
                       P_.block<kSize, kSize>(block(last), block(last)));
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
    if (node(i).drone > 0 && drones_[node(i).drone].name == peer) indices.push_back(i);
  }
  std::sort(indices.begin(), indices.end(),
            [&](int a, int b) { return node(a).stamp_ns < node(b).stamp_ns; });
  return indices;
}

WorldAlignment DriftFilter::alignment_by(int index) const {
  const Node& known = node(index);
  const auto error = x_.segment<kSize>(block(index));
  Eigen::Isometry3d correction = Eigen::Isometry3d::Identity();  // about the keyframe
  correction.linear() = exp_so3(error.tail<3>());
  correction.translation() = known.p + error.head<3>() - correction.linear() * known.p;
  const Matrix6d P = P_.block<kSize, kSize>(block(index), block(index));
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
