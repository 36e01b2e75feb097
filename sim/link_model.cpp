// SPDX-License-Identifier: Apache-2.0
#include "sim/link_model.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace covey {
namespace {

// The next state of the burst model: is this frame lost? `unit` is drawn from [0, 1).
bool next_is_bad(bool bad, double loss, double mean_burst, double unit) {
  if (loss <= 0) return false;
  if (loss >= 1) return true;
  // From the balance loss * p(bad to good) = (1 - loss) * p(good to bad) and the mean length of a
  // burst, 1 / p(bad to good).
  const double burst = std::max(mean_burst, 1 / (1 - loss));
  const double to_good = 1 / burst;
  const double to_bad = loss / (1 - loss) * to_good;
  return bad ? unit >= to_good : unit < to_bad;
}

bool contains(const std::vector<std::size_t>& list, std::size_t item) {
  return std::find(list.begin(), list.end(), item) != list.end();
}

}  // namespace

LinkModel::LinkModel(NetworkModel network, std::uint64_t seed) : network_(std::move(network)) {
  const std::size_t links = network_.drones * network_.drones;
  links_.reserve(links);
  for (std::size_t i = 0; i < links; ++i) links_.push_back({Random(seed, i)});
}

void LinkModel::begin_flight(double now_s, double pace) {
  flying_ = true;
  start_s_ = now_s;
  pace_ = pace;
}

FrameVerdict LinkModel::offer(double now_s, std::size_t from, std::size_t to, std::size_t bytes) {
  assert(from < network_.drones && to < network_.drones && from != to);
  Link& link = links_[from * network_.drones + to];
  const LinkQuality& quality = quality_of(from, to);
  // Always both draws: what is cut or finds the queue full does not change the luck of the others.
  const double luck = link.random.unit();
  const double jitter_s = quality.jitter_s * link.random.unit();
  link.bad = next_is_bad(link.bad, loss(quality, from, to, now_s), quality.mean_burst, luck);

  if (cut(from, to, now_s)) return {FrameFate::kCut, 0};
  double left_s = now_s;
  if (quality.rate_bit_per_s > 0) {
    const double turn_s = std::max(now_s, link.free_at_s);
    if (turn_s - now_s > quality.queue_s) return {FrameFate::kQueueFull, 0};
    left_s = turn_s + 8 * static_cast<double>(bytes) / quality.rate_bit_per_s;
    link.free_at_s = left_s;  // also of a frame that is lost on its way
  }
  if (link.bad) return {FrameFate::kLost, 0};
  link.last_arrival_s = std::max(link.last_arrival_s, left_s + quality.delay_s + jitter_s);
  return {FrameFate::kDelivered, link.last_arrival_s};
}

double LinkModel::flight_time_s(double now_s) const {
  return flying_ ? (now_s - start_s_) * pace_ : 0;
}

bool LinkModel::cut(std::size_t from, std::size_t to, double now_s) const {
  if (!flying_) return false;
  const double flown_s = flight_time_s(now_s);
  return std::any_of(network_.partitions.begin(), network_.partitions.end(),
                     [&](const Partition& partition) {
                       return flown_s >= partition.from_s && flown_s < partition.until_s &&
                              contains(partition.apart, from) != contains(partition.apart, to);
                     });
}

double LinkModel::loss(const LinkQuality& quality, std::size_t from, std::size_t to,
                       double now_s) const {
  if (network_.range.half_range_m <= 0 || !network_.distance_m) return quality.loss;
  const double ratio =
      network_.distance_m(from, to, flight_time_s(now_s)) / network_.range.half_range_m;
  const double x = std::pow(ratio, network_.range.steepness);
  const double by_distance = std::isfinite(x) ? x / (1 + x) : 1;
  return 1 - (1 - quality.loss) * (1 - by_distance);
}

const LinkQuality& LinkModel::quality_of(std::size_t from, std::size_t to) const {
  const auto special = network_.special.find({from, to});
  return special == network_.special.end() ? network_.quality : special->second;
}

}  // namespace covey
