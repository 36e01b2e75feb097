// SPDX-License-Identifier: Apache-2.0
#include "frontend/pattern_gain.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "estimator/median.h"

namespace covey {
namespace {

constexpr std::int16_t kNoStep = INT16_MIN;
// Blocks of the image, each of which gives an answer of its own. What stands still in the scene are
// edges along which the camera flies, and they run down the image rather than across.
constexpr int kAcross = 16, kDown = 4;

// Twice what a pixel differs from the mean of those beside it.
template <typename Pixel>
int step(const Pixel* beside) {
  return 2 * beside[1] - beside[0] - beside[2];
}

// Mean of absolute values, from every sixteenth row.
template <typename Pixel>
double mean_step(const cv::Mat& image) {
  constexpr int kEvery = 16;
  double sum = 0, count = 0;
  for (int y = kEvery / 2; y < image.rows; y += kEvery) {
    const Pixel* row = image.ptr<Pixel>(y);
    int of_row = 0;
    for (int x = 0; x + 2 < image.cols; ++x) of_row += std::abs(step(row + x));
    sum += of_row;
    count += image.cols - 2;
  }
  return count > 0 ? sum / count : 0;
}

// Grey levels in the order in which they were, in 16 bits with a sign: compilers then work on eight
// pixels at once.
std::int16_t level(std::uint8_t grey) { return grey; }
std::int16_t level(std::uint16_t grey) { return static_cast<std::int16_t>(grey ^ 0x8000); }

// None where a pixel is black or white, or the scene has an edge.
template <typename Pixel>
void steps_of_row(const Pixel* row, int count, int white, int edge_steps, std::int16_t* steps) {
  const std::int16_t darkest = level(Pixel{0}), brightest = level(static_cast<Pixel>(white));
  const auto edge = static_cast<std::int16_t>(edge_steps);
  for (int x = 0; x < count; ++x) {
    const std::int16_t left = level(row[x]), middle = level(row[x + 1]), right = level(row[x + 2]);
    const auto found = static_cast<std::int16_t>(2 * middle - left - right);
    const std::int16_t least = std::min(std::min(left, middle), right);
    const std::int16_t most = std::max(std::max(left, middle), right);
    const auto counts = static_cast<std::int16_t>(
        -static_cast<int>((found < edge) & (found > -edge) & (least > darkest) &
                          (most < brightest)));  // all bits or none
    steps[x] = static_cast<std::int16_t>((found & counts) | (kNoStep & ~counts));
  }
}

// The steps of an image, row by row.
class Steps {
 public:
  // `edge`: PatternGainConfig's.
  Steps(const cv::Mat& image, int white, double edge)
      : image_(image), white_(white), row_(static_cast<std::size_t>(image.cols), kNoStep) {
    constexpr double kMostEdge = 8000;  // grey levels
    const double mean =
        is_small() ? mean_step<std::uint8_t>(image) : mean_step<std::uint16_t>(image);
    edge_ = static_cast<int>(std::min(std::ceil(edge * mean), kMostEdge));
  }

  // Valid until the next row is asked for.
  const std::vector<std::int16_t>& of_row(int y) {
    std::int16_t* out = row_.data() + 1;
    const int count = image_.cols - 2;
    if (is_small()) {
      steps_of_row(image_.ptr<std::uint8_t>(y), count, white_, edge_, out);
    } else {
      steps_of_row(image_.ptr<std::uint16_t>(y), count, white_, edge_, out);
    }
    return row_;
  }

 private:
  [[nodiscard]] bool is_small() const { return image_.depth() == CV_8U; }

  const cv::Mat& image_;
  int white_, edge_ = 0;
  std::vector<std::int16_t> row_;
};

// Sum of the products of steps and pattern, and how many steps there are.
struct Product {
  double sum = 0, count = 0;
  void operator+=(const Product& other) {
    sum += other.sum;
    count += other.count;
  }
};
Product product(const std::int16_t* steps, const std::int16_t* pattern, int size) {
  int sum = 0, count = 0;
  for (int x = 0; x < size; ++x) {
    const auto counts = static_cast<std::int16_t>(-static_cast<int>(steps[x] != kNoStep));
    sum += static_cast<std::int16_t>(steps[x] & counts) * pattern[x];
    count -= counts;
  }
  return {static_cast<double>(sum), static_cast<double>(count)};
}

void learn(const std::vector<std::int16_t>& steps, float gain, float share, float* mean) {
  for (std::size_t x = 0; x < steps.size(); ++x) {
    const float of_this = steps[x] != kNoStep ? share : 0.0F;
    mean[x] += of_this * (gain * static_cast<float>(steps[x]) - mean[x]);
  }
}

// How strong the pattern is, and how sure that is relative to it.
struct Strength {
  double mean = 0, sigma = 0;
};

// Each block says found over wanted. An edge of the scene that has stayed where it was for long
// makes some of them wrong: Cauchy's weights, and no block counts for more than most do. Nothing
// where less than a quarter of the blocks tell.
std::optional<Strength> agreed_strength(const std::vector<double>& found,
                                        const std::vector<double>& wanted) {
  std::vector<double> said, weights;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (!(wanted[i] > 0)) continue;
    said.push_back(found[i] / wanted[i]);
    weights.push_back(wanted[i]);
  }
  if (4 * said.size() < found.size()) return std::nullopt;
  const double most = median(weights);
  for (double& weight : weights) weight = std::min(weight, most);
  Strength strength{median(said), 0};
  std::vector<double> distances(said.size());
  constexpr int kIterations = 3;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    for (std::size_t i = 0; i < said.size(); ++i) {
      distances[i] = std::abs(said[i] - strength.mean);
    }
    constexpr double kCauchy = 2.385 / 0.6745;  // 95 % efficient, per median absolute residual
    const double scale = std::max(kCauchy * median(distances), 1e-9);
    double sum = 0, total = 0, squares = 0, slope = 0;
    for (std::size_t i = 0; i < said.size(); ++i) {
      const double r = (said[i] - strength.mean) / scale;
      const double weight = weights[i] / (1 + r * r);
      sum += weight * said[i];
      total += weight;
      squares += weight * weight * distances[i] * distances[i];
      slope += weight * (1 - r * r) / (1 + r * r);  // by how much the sum follows the mean
    }
    strength = {sum / total, std::sqrt(squares) / slope};
  }
  if (!(strength.mean > 0 && strength.sigma > 0)) return std::nullopt;
  strength.sigma /= strength.mean;
  return strength;
}

cv::Range part(int size, int index, int parts) {
  return {size * index / parts, size * (index + 1) / parts};
}

}  // namespace

void PatternGain::restart(const cv::Mat& first, int white, double gain) {
  first.copyTo(first_.image);
  first_.white = white;
  first_.gain = gain;
  waiting_.image.release();
  for (cv::Mat& half : halves_) half = cv::Mat::zeros(first.rows / 2, first.cols, CV_32FC1);
  looks_ = 0;
  unit_ = std::nullopt;
}

void PatternGain::look(const cv::Mat& image, int white, double gain) {
  if (!waiting_.image.empty()) learn_waiting();
  image.copyTo(waiting_.image);
  waiting_.white = white;
  waiting_.gain = gain;
}

void PatternGain::learn_waiting() {
  cv::Mat& half = halves_[static_cast<std::size_t>(looks_ % 2)];
  const int before = std::min(looks_ / 2, config_.memory - 1);
  ++looks_;
  Steps steps(waiting_.image, waiting_.white, config_.edge);
  for (int y = 0; y < half.rows; ++y) {
    learn(steps.of_row(2 * y), static_cast<float>(waiting_.gain),
          1 / static_cast<float>(before + 1), half.ptr<float>(y));
  }
  if (looks_ >= config_.fewest_looks) tell_pattern();
}

void PatternGain::tell_pattern() {
  unit_ = std::nullopt;
  power_.clear();
  double power = 0;
  for (int i = 0; i < kDown; ++i) {
    const cv::Range rows = part(halves_[0].rows, i, kDown);
    for (int k = 0; k < kAcross; ++k) {
      const cv::Range columns = part(halves_[0].cols, k, kAcross);
      const cv::Mat one = halves_[0](rows, columns), other = halves_[1](rows, columns);
      power_.push_back(one.dot(other) / static_cast<double>(one.total()));
      power += power_.back() / (kAcross * kDown);
    }
  }
  if (!(power > 0)) return;
  constexpr double kUsual = 100, kMost = 1000;  // what is kept as whole numbers: root mean square
  const double scale = kUsual / std::sqrt(power);
  for (double& of_block : power_) of_block *= scale;
  cv::addWeighted(halves_[0], scale / 2, halves_[1], scale / 2, 0, pattern_, CV_16S);
  pattern_ = cv::max(cv::min(pattern_, kMost), -kMost);
  unit_ = against_pattern(first_.image, first_.white);
}

std::optional<MeasuredGain> PatternGain::against_pattern(const cv::Mat& image, int white) const {
  Steps steps(image, white, config_.edge);
  std::vector<double> found, wanted;
  for (int i = 0; i < kDown; ++i) {
    const cv::Range rows = part(pattern_.rows, i, kDown);
    std::array<Product, kAcross> blocks{};
    for (int y = rows.start; y < rows.end; ++y) {
      const std::int16_t* seen = steps.of_row(2 * y).data();
      const auto* known = pattern_.ptr<std::int16_t>(y);
      for (int k = 0; k < kAcross; ++k) {
        const cv::Range columns = part(pattern_.cols, k, kAcross);
        blocks[static_cast<std::size_t>(k)] +=
            product(seen + columns.start, known + columns.start, columns.size());
      }
    }
    for (const Product& block : blocks) {
      wanted.push_back(power_[wanted.size()] * block.count);
      found.push_back(block.sum);
    }
  }
  const auto strength = agreed_strength(found, wanted);
  if (!strength || !(strength->sigma < config_.trusted_sigma)) return std::nullopt;
  return MeasuredGain{-std::log(strength->mean), strength->sigma};
}

std::optional<MeasuredGain> PatternGain::measure(const cv::Mat& image, int white) const {
  if (!unit_) return std::nullopt;
  const auto found = against_pattern(image, white);
  if (!found) return std::nullopt;
  return MeasuredGain{std::log(first_.gain) + found->log_gain - unit_->log_gain, found->sigma};
}

}  // namespace covey
