// SPDX-License-Identifier: Apache-2.0
#include "apps/thermal_comparison.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "sim/field_slope.h"

namespace covey {
namespace {

constexpr double kWhiteLevel = 255;
constexpr double kSettled_s = 2;  // a chain's field has been seen by then

// Temperature of grey level 0, and of a step between two levels.
struct Scale {
  double black_k = 0, level_k = 1;  // K
};

Scale scale_of(const ThermalTruthRecord& truth, std::optional<double> kelvin_per_count) {
  if (kelvin_per_count) return {0, *kelvin_per_count};
  return {truth.black_k, (truth.white_k - truth.black_k) / kWhiteLevel};
}

const ThermalTruthRecord* record_of(const std::vector<ThermalTruthRecord>& truth, TimeNs stamp_ns) {
  const auto found = std::lower_bound(
      truth.begin(), truth.end(), stamp_ns,
      [](const ThermalTruthRecord& record, TimeNs stamp) { return record.stamp_ns < stamp; });
  return found != truth.end() && found->stamp_ns == stamp_ns ? &*found : nullptr;
}

// What the calibration should have found: from an image's grey levels to those of its chain's
// first.
GainOffset true_map(const Scale& first, const Scale& now) {
  return {now.level_k / first.level_k, (now.black_k - first.black_k) / first.level_k};
}

struct Compared {
  PhotometricRecord estimate, truth;
};

class ErrorSum {
 public:
  void add(double error) {
    sum_ += error;
    worst_ = std::max(worst_, error);
    ++count_;
  }
  [[nodiscard]] std::optional<GainErrors> errors() const {
    if (count_ == 0) return std::nullopt;
    return GainErrors{sum_ / count_, worst_};
  }

 private:
  double sum_ = 0, worst_ = 0;
  int count_ = 0;
};

// Between each image and the last one of its chain that is at least `apart_s` older.
std::optional<GainErrors> errors_over(const std::vector<Compared>& images, double apart_s) {
  ErrorSum sum;
  std::size_t before = 0;
  for (const Compared& now : images) {
    const auto old_enough = [&](std::size_t i) {
      return seconds_between(images[i].truth.stamp_ns, now.truth.stamp_ns) >= apart_s;
    };
    while (before + 1 < images.size() && old_enough(before + 1)) ++before;
    const Compared& past = images[before];
    if (!old_enough(before) || past.truth.chain_ns != now.truth.chain_ns) continue;
    const double estimated = now.estimate.map.gain / past.estimate.map.gain;
    const double really = now.truth.map.gain / past.truth.map.gain;
    sum.add(std::abs(estimated / really - 1));
  }
  return sum.errors();
}

double gain_ratio(const Compared& image) { return image.estimate.map.gain / image.truth.map.gain; }

std::optional<GainErrors> errors_of_chains(const std::vector<Compared>& images) {
  ErrorSum sum;
  for (const Compared& image : images) {
    if (seconds_between(image.truth.chain_ns, image.truth.stamp_ns) < kSettled_s) continue;
    sum.add(std::abs(gain_ratio(image) - 1));
  }
  return sum.errors();
}

std::optional<GainErrors> errors_within_chains(const std::vector<Compared>& images) {
  ErrorSum sum;
  for (auto first = images.begin(); first != images.end();) {
    const auto last = std::find_if(first, images.end(), [&](const Compared& image) {
      return image.truth.chain_ns != first->truth.chain_ns;
    });
    const double log_factor = std::accumulate(first, last, 0.0,
                                              [](double all, const Compared& image) {
                                                return all + std::log(gain_ratio(image));
                                              }) /
                              static_cast<double>(last - first);
    if (last - first > 1) {
      std::for_each(first, last, [&](const Compared& image) {
        sum.add(std::abs(gain_ratio(image) / std::exp(log_factor) - 1));
      });
    }
    first = last;
  }
  return sum.errors();
}

double rms(const cv::Mat& values) {
  return cv::norm(values, cv::NORM_L2) / std::sqrt(static_cast<double>(values.total()));
}

struct FieldFigures {
  double ratio = 0, ratio_without_slope = 0, truth_k = 0;
};

// The field's mean is a part of the offset.
FieldFigures compare_fields(const cv::Mat& field, double level_k, const cv::Mat& truth_k) {
  const cv::Mat truth = truth_k - cv::mean(truth_k)[0];
  cv::Mat estimate;
  cv::resize(field, estimate, truth.size(), 0, 0, cv::INTER_AREA);
  estimate *= level_k;
  estimate -= cv::mean(estimate)[0];
  constexpr double kLeast = 1e-9;  // K
  const cv::Mat error = estimate - truth;
  return {rms(error) / std::max(rms(truth), kLeast),
          rms(without_slope(error)) / std::max(rms(without_slope(truth)), kLeast), rms(truth)};
}

void compare_all_fields(const std::vector<FieldRecord>& fields,
                        const std::vector<ThermalTruthRecord>& truth,
                        std::optional<double> kelvin_per_count, ThermalComparison& result) {
  double ratios = 0, without_slope = 0, truths_k = 0;
  int count = 0;
  for (const FieldRecord& record : fields) {
    const ThermalTruthRecord* now = record_of(truth, record.stamp_ns);
    const ThermalTruthRecord* first = record_of(truth, record.chain_ns);
    if (now == nullptr || first == nullptr || now->field.empty()) continue;
    const FieldFigures figures = compare_fields(
        record.field, scale_of(*first, kelvin_per_count).level_k, read_true_field(now->field));
    result.field_rms_over.emplace_back(seconds_between(truth.front().stamp_ns, record.stamp_ns),
                                       figures.ratio);
    if (seconds_between(record.chain_ns, record.stamp_ns) < kSettled_s) continue;
    ratios += figures.ratio;
    without_slope += figures.ratio_without_slope;
    truths_k += figures.truth_k;
    ++count;
  }
  if (count == 0) return;
  result.field_rms = ratios / count;
  result.field_rms_without_slope = without_slope / count;
  result.true_field_k = truths_k / count;
}

}  // namespace

ThermalComparison compare_with_truth(const std::vector<PhotometricRecord>& gains,
                                     const std::vector<FieldRecord>& fields,
                                     const std::vector<ThermalTruthRecord>& truth,
                                     std::optional<double> kelvin_per_count) {
  std::vector<Compared> images;
  for (const PhotometricRecord& record : gains) {
    const ThermalTruthRecord* now = record_of(truth, record.stamp_ns);
    const ThermalTruthRecord* first = record_of(truth, record.chain_ns);
    if (now == nullptr || first == nullptr) continue;
    const GainOffset map =
        true_map(scale_of(*first, kelvin_per_count), scale_of(*now, kelvin_per_count));
    images.push_back({record, {record.stamp_ns, record.chain_ns, map}});
  }
  ThermalComparison result;
  result.third = errors_over(images, 1.0 / 3);
  result.second = errors_over(images, 1.0);
  result.chain = errors_of_chains(images);
  result.within_chain = errors_within_chains(images);
  for (const Compared& image : images) result.true_gains.push_back(image.truth);
  compare_all_fields(fields, truth, kelvin_per_count, result);
  return result;
}

}  // namespace covey
