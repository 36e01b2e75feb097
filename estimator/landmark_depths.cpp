// SPDX-License-Identifier: Apache-2.0
#include "estimator/landmark_depths.h"

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "estimator/median.h"

namespace covey {
namespace {

double depth_error(const State& state, int landmark) {
  const int rho = state.landmark_offset(landmark) + 2;
  return std::sqrt(state.covariance()(rho, rho)) /
         state.landmarks()[static_cast<std::size_t>(landmark)].inverse_depth.z();
}

}  // namespace

double metric_depth_error(const State& state, int landmark) {
  const int rho = state.landmark_offset(landmark) + 2, scale = State::kScale;
  const double value = state.landmarks()[static_cast<std::size_t>(landmark)].inverse_depth.z();
  const auto P = state.covariance();
  return std::sqrt(P(rho, rho) / (value * value) - 2 * P(rho, scale) / value + P(scale, scale));
}

std::optional<double> median_depth_error(const State& state) {
  std::vector<double> errors;
  errors.reserve(state.landmarks().size());
  for (int i = 0; i < static_cast<int>(state.landmarks().size()); ++i) {
    errors.push_back(depth_error(state, i));
  }
  if (errors.empty()) return std::nullopt;
  return median(std::move(errors));
}

double median_depth(const State& state) {
  std::vector<double> depths;
  for (const SlamLandmark& landmark : state.landmarks()) {
    if (landmark.inverse_depth.z() > 0) depths.push_back(1 / landmark.inverse_depth.z());
  }
  return depths.empty() ? 0 : median(std::move(depths));
}

}  // namespace covey
