// SPDX-License-Identifier: Apache-2.0
//
// Gain and offset of each image against a window of past ones. Automatic gain stretches the
// temperatures between two levels to grey levels; gains and offsets form the one-dimensional affine
// group, are chained over the window and averaged (Das, Matthies and Daftry, RA-L 2021, section
// III). What they call a frame's parameters is here the map from its grey levels to those of the
// chain's first image.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/pattern_gain.h"

namespace covey {

// calibrated = gain * grey + offset, both in grey levels.
struct GainOffset {
  double gain = 1, offset = 0;
  [[nodiscard]] double operator()(double grey) const { return gain * grey + offset; }
};

struct TemporalConfig {
  int window = 10;                  // past images an image is compared with
  int spacing = 3;                  // images between two of them
  int patch_radius_px = 5;          // px, of the warped patch whose mean is compared: 11 x 11
  int min_tracks = 12;              // shared with a past image, otherwise the two are not compared
  int iterations = 20;              // of reweighting at most
  double relaxation_s = 5;          // s, time constant of the pull back to what add() is given
  double link_sigma = 0.02;         // of the logarithm of the gain that tracks tell
  double contradiction_sigmas = 5;  // by which it differs from what the pattern tells: they deny it
};

// The same patch in two images: its mean, grey levels of either.
struct GreyPair {
  double now = 0, past = 0;
};

// past = gain * now + offset: orthogonal regression (Deming 1943), closed form in the 2x2
// covariance, because both sides are equally noisy and a plain regression would shrink the gain a
// little with each image; reweighted by Cauchy's function. Nothing for fewer than three pairs, or
// when they do not vary.
[[nodiscard]] std::optional<GainOffset> fit_gain_offset(const std::vector<GreyPair>& pairs,
                                                        int iterations);

// A patch in one image.
struct TrackGrey {
  std::uint64_t patch_id = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double grey = 0;  // its mean, grey levels of the image
};

// The additive field at a pixel, calibrated grey levels.
using FieldAt = std::function<double(const Eigen::Vector2d& pixel)>;

class TemporalGain {
 public:
  explicit TemporalGain(const TemporalConfig& config) : config_(config) {}

  // Tracks by rising patch_id, here and below.
  // The map of an image from its tracks, and from the gain that the sensor's pattern tells; what
  // neither says is as in the image before. `field`: as it is known now, for this image and the
  // past ones alike. A field that was learnt in between would look like a gain.
  [[nodiscard]] GainOffset estimate(const std::vector<TrackGrey>& tracks, const FieldAt& field,
                                    const std::optional<MeasuredGain>& told) const;

  // Estimates and remembers; images in time order. Errors of the chain would add up without end:
  // the map is pulled towards `anchor`, its gain only where the pattern does not tell it.
  GainOffset add(TimeNs stamp_ns, std::vector<TrackGrey> tracks, const FieldAt& field,
                 const std::optional<MeasuredGain>& told, const GainOffset& anchor);

  // Images in a row in which the tracks contradicted what was told.
  [[nodiscard]] int contradictions() const { return contradictions_; }

  // Forgets the window; what follows is in the units of `first`.
  void restart(const GainOffset& first);

  [[nodiscard]] const GainOffset& latest() const { return latest_; }

 private:
  struct PastImage {
    GainOffset map;
    std::vector<TrackGrey> tracks;  // by id
  };
  // An image's tracks, two for each of them that are nearest to it, and the field at each.
  struct PresentImage {
    const std::vector<TrackGrey>& tracks;
    std::vector<std::size_t> nearest;
    std::vector<double> field_here;
    const FieldAt& field;
  };
  [[nodiscard]] static PresentImage present_image(const std::vector<TrackGrey>& tracks,
                                                  const FieldAt& field);
  [[nodiscard]] bool is_sure(const std::optional<MeasuredGain>& told) const;
  [[nodiscard]] GainOffset estimate(const PresentImage& present,
                                    const std::optional<MeasuredGain>& told) const;
  [[nodiscard]] bool contradicts(const PresentImage& present, const MeasuredGain& told) const;
  [[nodiscard]] std::vector<std::optional<GreyPair>> shared(const PastImage& past,
                                                            const PresentImage& present) const;
  [[nodiscard]] std::optional<double> gain_of_neighbours(
      const std::vector<std::optional<GreyPair>>& seen, const PresentImage& present) const;
  [[nodiscard]] std::optional<GainOffset> against(const PastImage& past,
                                                  const PresentImage& present,
                                                  std::optional<double> known) const;
  [[nodiscard]] GainOffset relaxed(const GainOffset& map, const GainOffset& anchor, double grey,
                                   double elapsed_s) const;

  TemporalConfig config_;
  std::deque<PastImage> images_;  // newest first
  GainOffset latest_;
  int contradictions_ = 0;
  TimeNs last_ns_ = 0;
};

}  // namespace covey
