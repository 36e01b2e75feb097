// SPDX-License-Identifier: Apache-2.0
#include "frontend/temporal_gain.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "estimator/median.h"

namespace covey {
namespace {

struct Moments {
  double now = 0, past = 0;       // weighted means
  double nn = 0, np = 0, pp = 0;  // weighted covariance
};

Moments moments(const std::vector<GreyPair>& pairs, const std::vector<double>& weights) {
  Moments m;
  double total = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    total += weights[i];
    m.now += weights[i] * pairs[i].now;
    m.past += weights[i] * pairs[i].past;
  }
  m.now /= total;
  m.past /= total;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double now = pairs[i].now - m.now, past = pairs[i].past - m.past;
    m.nn += weights[i] * now * now / total;
    m.np += weights[i] * now * past / total;
    m.pp += weights[i] * past * past / total;
  }
  return m;
}

// Noise of `past` is `ratio` times that of `now`.
std::optional<GainOffset> orthogonal_fit(const Moments& m, double ratio) {
  constexpr double kLeastVariance = 1e-6;  // grey levels^2
  const double scaled = ratio * ratio;
  if (!(m.np > 0) || m.nn < kLeastVariance || m.pp < kLeastVariance) return std::nullopt;
  const double difference = m.pp - scaled * m.nn;
  GainOffset map;
  map.gain =
      (difference + std::sqrt(difference * difference + 4 * scaled * m.np * m.np)) / (2 * m.np);
  map.offset = m.past - map.gain * m.now;
  return map;
}

[[maybe_unused]] bool is_by_patch(const std::vector<TrackGrey>& tracks) {
  return std::is_sorted(tracks.begin(), tracks.end(), [](const TrackGrey& a, const TrackGrey& b) {
    return a.patch_id < b.patch_id;
  });
}

double mean_grey(const std::vector<TrackGrey>& tracks) {
  double sum = 0;
  for (const TrackGrey& track : tracks) sum += track.grey;
  return sum / static_cast<double>(tracks.size());
}

constexpr std::size_t kNearest = 2;  // neighbours of a track it is compared with

// The first kNearest entries are those of tracks[0], and so on; a track without stands for itself.
std::vector<std::size_t> nearest_of_each(const std::vector<TrackGrey>& tracks) {
  std::vector<std::size_t> nearest;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    std::size_t first = i, second = i;
    double least = std::numeric_limits<double>::infinity(), next = least;  // px^2
    for (std::size_t k = 0; k < tracks.size(); ++k) {
      const double distance = (tracks[i].pixel - tracks[k].pixel).squaredNorm();
      if (k == i || distance >= next) continue;
      const bool nearer = distance < least;
      second = nearer ? std::exchange(first, k) : k;
      next = nearer ? std::exchange(least, distance) : distance;
    }
    nearest.insert(nearest.end(), {first, second});
  }
  return nearest;
}

std::vector<double> distances(const std::vector<GreyPair>& pairs, const GainOffset& map) {
  std::vector<double> distances;
  distances.reserve(pairs.size());
  for (const GreyPair& pair : pairs) distances.push_back(std::abs(pair.past - map(pair.now)));
  return distances;
}

// Mean of two logarithms, each as certain as it says.
double weighted(const MeasuredGain& told, double log_gain, double sigma) {
  const double share = sigma * sigma / (sigma * sigma + told.sigma * told.sigma);
  return log_gain + share * (told.log_gain - log_gain);
}

}  // namespace

std::optional<GainOffset> fit_gain_offset(const std::vector<GreyPair>& pairs, int iterations) {
  if (pairs.size() < 3) return std::nullopt;
  // Start: spread against spread, by medians, so that outliers do not even steer the first step.
  std::vector<double> now, past;
  for (const GreyPair& pair : pairs) {
    now.push_back(pair.now);
    past.push_back(pair.past);
  }
  const double now_middle = median(now), past_middle = median(past);
  for (double& value : now) value = std::abs(value - now_middle);
  for (double& value : past) value = std::abs(value - past_middle);
  const double now_spread = median(now), past_spread = median(past);
  if (!(now_spread > 0) || !(past_spread > 0)) return std::nullopt;
  GainOffset map;
  map.gain = past_spread / now_spread;
  map.offset = past_middle - map.gain * now_middle;

  constexpr double kCauchy = 2.385 / 0.6745;  // 95 % efficient, per median absolute residual
  constexpr double kConverged = 1e-4;         // relative change of the gain
  std::vector<double> weights(pairs.size());
  for (int i = 0; i < iterations; ++i) {
    const std::vector<double> residuals = distances(pairs, map);
    const double scale = std::max(kCauchy * median(residuals), 1e-9);
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const double r = residuals[k] / scale;
      weights[k] = 1 / (1 + r * r);
    }
    const auto better = orthogonal_fit(moments(pairs, weights), map.gain);
    if (!better) return std::nullopt;
    const bool converged = std::abs(better->gain / map.gain - 1) < kConverged;
    map = *better;
    if (converged) break;
  }
  return map;
}

// What the same patches are in both images, the field taken out; both lists are sorted by id.
// Nothing where they share too few.
std::vector<std::optional<GreyPair>> TemporalGain::shared(const PastImage& past,
                                                          const PresentImage& present) const {
  std::vector<std::optional<GreyPair>> seen(present.tracks.size());
  std::size_t shared = 0;
  auto before = past.tracks.begin();
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const TrackGrey& track = present.tracks[i];
    while (before != past.tracks.end() && before->patch_id < track.patch_id) ++before;
    if (before == past.tracks.end()) break;
    if (before->patch_id != track.patch_id) continue;
    seen[i] = GreyPair{track.grey - present.field_here[i] / latest_.gain,
                       before->grey - present.field(before->pixel) / past.map.gain};
    ++shared;
  }
  if (shared < static_cast<std::size_t>(config_.min_tracks)) seen.clear();
  return seen;
}

// The gain is fitted to how much neighbours differ: over so short a distance a field of low
// frequency differs little, and motion blur or the distance to the scene change the contrast within
// a patch, but hardly its mean.
std::optional<double> TemporalGain::gain_of_neighbours(
    const std::vector<std::optional<GreyPair>>& seen, const PresentImage& present) const {
  std::vector<GreyPair> differences;
  for (std::size_t k = 0; k < present.nearest.size(); ++k) {
    const auto &track = seen[k / kNearest], &beside = seen[present.nearest[k]];
    if (!track || !beside) continue;
    const GreyPair difference{track->now - beside->now, track->past - beside->past};
    const double sign = k % 2 == 0 ? 1 : -1;  // they are about zero: no difference stays none
    differences.push_back({sign * difference.now, sign * difference.past});
  }
  const auto link = fit_gain_offset(differences, config_.iterations);
  if (!link) return std::nullopt;
  return link->gain;
}

// Offset from the means, and the gain too unless it is `known`.
std::optional<GainOffset> TemporalGain::against(const PastImage& past, const PresentImage& present,
                                                std::optional<double> known) const {
  const std::vector<std::optional<GreyPair>> seen = shared(past, present);
  if (seen.empty()) return std::nullopt;
  const auto link = known ? *known / past.map.gain : gain_of_neighbours(seen, present);
  if (!link) return std::nullopt;
  std::vector<double> offsets;
  for (const auto& pair : seen) {
    if (pair) offsets.push_back(pair->past - *link * pair->now);
  }
  return GainOffset{past.map.gain * *link, past.map(median(std::move(offsets)))};
}

TemporalGain::PresentImage TemporalGain::present_image(const std::vector<TrackGrey>& tracks,
                                                       const FieldAt& field) {
  assert(is_by_patch(tracks));
  PresentImage present{tracks, {}, {}, field};
  for (const TrackGrey& track : tracks) present.field_here.push_back(field(track.pixel));
  return present;
}

// Sure enough that tracks need not be asked for the gain.
bool TemporalGain::is_sure(const std::optional<MeasuredGain>& told) const {
  return told && contradictions_ == 0 && told->sigma < config_.link_sigma;
}

GainOffset TemporalGain::estimate(const std::vector<TrackGrey>& tracks, const FieldAt& field,
                                  const std::optional<MeasuredGain>& told) const {
  PresentImage present = present_image(tracks, field);
  if (!is_sure(told)) present.nearest = nearest_of_each(tracks);
  return estimate(present, told);
}

GainOffset TemporalGain::estimate(const PresentImage& present,
                                  const std::optional<MeasuredGain>& told) const {
  const std::vector<TrackGrey>& tracks = present.tracks;
  const bool known = is_sure(told);
  const double middle = mean_grey(tracks);  // where the offsets are averaged
  double log_gain = 0, level = 0;
  int links = 0;
  const auto spacing = static_cast<std::size_t>(config_.spacing);
  for (std::size_t lag = 0; lag < images_.size(); lag += spacing) {
    const auto map = against(images_[lag], present,
                             known ? std::optional(std::exp(told->log_gain)) : std::nullopt);
    if (!map) continue;
    log_gain += std::log(map->gain);
    level += (*map)(middle);
    ++links;
  }
  if (links == 0) {
    if (!known || tracks.empty()) return latest_;
    const double gain = std::exp(told->log_gain);
    return {gain, latest_(middle) - gain * middle};
  }
  log_gain /= links;
  if (told && contradictions_ == 0 && !known)
    log_gain = weighted(*told, log_gain, config_.link_sigma);
  GainOffset map;
  map.gain = std::exp(log_gain);
  map.offset = level / links - map.gain * middle;
  return map;
}

// Against one image of the window: that is enough to see what is far off.
bool TemporalGain::contradicts(const PresentImage& present, const MeasuredGain& told) const {
  if (images_.empty()) return false;
  const auto map = against(images_[images_.size() / 2], present, std::nullopt);
  return map && std::abs(told.log_gain - std::log(map->gain)) >
                    config_.contradiction_sigmas * std::hypot(config_.link_sigma, told.sigma);
}

GainOffset TemporalGain::relaxed(const GainOffset& map, const GainOffset& anchor, double grey,
                                 double elapsed_s) const {
  const double keep = std::exp(-elapsed_s / config_.relaxation_s);
  GainOffset pulled;
  pulled.gain = anchor.gain * std::pow(map.gain / anchor.gain, keep);
  pulled.offset = anchor(grey) + keep * (map(grey) - anchor(grey)) - pulled.gain * grey;
  return pulled;
}

GainOffset TemporalGain::add(TimeNs stamp_ns, std::vector<TrackGrey> tracks, const FieldAt& field,
                             const std::optional<MeasuredGain>& told, const GainOffset& anchor) {
  PresentImage present = present_image(tracks, field);
  present.nearest = nearest_of_each(tracks);
  contradictions_ = told && contradicts(present, *told) ? contradictions_ + 1 : 0;
  GainOffset map = estimate(present, told);
  if (last_ns_ != 0 && !tracks.empty()) {
    const double grey = mean_grey(tracks), since_s = seconds_between(last_ns_, stamp_ns);
    const GainOffset same_gain{map.gain, anchor(grey) - map.gain * grey};
    map = relaxed(map, told && contradictions_ == 0 ? same_gain : anchor, grey, since_s);
  }
  last_ns_ = stamp_ns;
  latest_ = map;
  images_.push_front({map, std::move(tracks)});
  const auto spacing = static_cast<std::size_t>(config_.spacing);
  const auto kept = static_cast<std::size_t>(config_.window) * spacing;
  if (images_.size() > kept) images_.pop_back();
  return latest_;
}

void TemporalGain::restart(const GainOffset& first) {
  images_.clear();
  contradictions_ = 0;
  latest_ = first;
}

}  // namespace covey
