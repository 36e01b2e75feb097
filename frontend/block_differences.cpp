// SPDX-License-Identifier: Apache-2.0
#include "frontend/block_differences.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

namespace covey {
namespace {

constexpr int kBlock = 8;  // squares, side of a block
constexpr int kSquares = kBlock * kBlock;

// From a square's first pixel to its middle.
Eigen::Vector2d to_centre(int side_px) { return Eigen::Vector2d::Constant(0.5 * (side_px - 1)); }
Eigen::Vector2d to_pixels(const Eigen::Vector2d& square, int side_px) {
  return side_px * square + to_centre(side_px);
}
Eigen::Vector2d to_squares(const Eigen::Vector2d& pixel, int side_px) {
  return (pixel - to_centre(side_px)) / side_px;
}

template <typename Pixel>
cv::Mat means(const cv::Mat& image, int white, int side_px) {
  cv::Mat small(image.rows / side_px, image.cols / side_px, CV_32FC1);
  for (int y = 0; y < small.rows; ++y) {
    auto* out = small.ptr<float>(y);
    for (int x = 0; x < small.cols; ++x) {
      int sum = 0;
      Pixel least = std::numeric_limits<Pixel>::max(), most = 0;
      for (int v = 0; v < side_px; ++v) {
        const Pixel* in = image.ptr<Pixel>(side_px * y + v) + std::ptrdiff_t{side_px} * x;
        for (int u = 0; u < side_px; ++u) {
          sum += in[u];
          least = std::min(least, in[u]);
          most = std::max(most, in[u]);
        }
      }
      out[x] = least == 0 || most >= white
                   ? std::numeric_limits<float>::quiet_NaN()
                   : static_cast<float>(sum) / static_cast<float>(side_px * side_px);
    }
  }
  return small;
}

// A place of the scene in one sight and the other.
struct Motion {
  Eigen::Vector2d here, there;  // px
};

std::vector<Motion> shared(const std::vector<TrackGrey>& here,
                           const std::vector<TrackGrey>& there) {
  std::vector<Motion> motions;
  auto other = there.begin();
  for (const TrackGrey& seen : here) {
    while (other != there.end() && other->patch_id < seen.patch_id) ++other;
    if (other == there.end()) break;
    if (other->patch_id == seen.patch_id) motions.push_back({seen.pixel, other->pixel});
  }
  return motions;
}

// From one sight to the other: a quadratic map for the whole image, and how the nearest tracks
// depart from it.
class Flow {
 public:
  Flow(std::vector<Motion> motions, const cv::Size& image, const BlockConfig& config)
      : motions_(std::move(motions)),
        near2_(config.near_px * config.near_px),
        far2_(config.far_px * config.far_px),
        centre_(0.5 * image.width, 0.5 * image.height),
        scale_(0.5 * image.width) {
    const auto rows = static_cast<Eigen::Index>(motions_.size());
    Eigen::MatrixXd A(rows, kTerms), b(rows, 2);
    for (Eigen::Index i = 0; i < rows; ++i) {
      const Motion& motion = motions_[static_cast<std::size_t>(i)];
      A.row(i) = terms(motion.here).transpose();
      b.row(i) = (motion.there - motion.here).transpose();
    }
    coefficients_ = A.colPivHouseholderQr().solve(b);
    rest_ = b - A * coefficients_;
  }

  [[nodiscard]] Eigen::Vector2d there(const Eigen::Vector2d& here) const {
    double total = 1 / far2_;
    Eigen::Vector2d rest = Eigen::Vector2d::Zero();
    for (const auto& [distance2, i] : nearest(here)) {
      const double weight = 1 / (distance2 + near2_);
      rest += weight * rest_.row(i).transpose();
      total += weight;
    }
    return here + coefficients_.transpose() * terms(here) + rest / total;
  }
  // d(there)/d(here), of the map alone.
  [[nodiscard]] Eigen::Matrix2d slope(const Eigen::Vector2d& here) const {
    const Eigen::Vector2d p = (here - centre_) / scale_;
    Eigen::Matrix<double, kTerms, 2> J;
    J << 0, 0, 1, 0, 0, 1, 2 * p.x(), 0, p.y(), p.x(), 0, 2 * p.y();
    return Eigen::Matrix2d::Identity() + coefficients_.transpose() * J / scale_;
  }

 private:
  static constexpr int kTerms = 6;
  [[nodiscard]] Eigen::Matrix<double, kTerms, 1> terms(const Eigen::Vector2d& pixel) const {
    const Eigen::Vector2d p = (pixel - centre_) / scale_;
    return {1, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y()};
  }
  using Neighbour = std::pair<double, Eigen::Index>;  // px^2, row
  [[nodiscard]] std::array<Neighbour, 3> nearest(const Eigen::Vector2d& here) const {
    std::array<Neighbour, 3> found;
    found.fill({std::numeric_limits<double>::max(), 0});
    for (std::size_t i = 0; i < motions_.size(); ++i) {
      const double distance2 = (motions_[i].here - here).squaredNorm();
      if (distance2 >= found[2].first) continue;
      found[2] = {distance2, static_cast<Eigen::Index>(i)};
      if (found[2] < found[1]) std::swap(found[1], found[2]);
      if (found[1] < found[0]) std::swap(found[0], found[1]);
    }
    return found;
  }

  std::vector<Motion> motions_;
  double near2_, far2_;  // px^2
  Eigen::Vector2d centre_;
  double scale_;                                   // px
  Eigen::Matrix<double, kTerms, 2> coefficients_;  // px
  Eigen::MatrixXd rest_;                           // motions x 2, px
};

struct Texture {
  Eigen::Matrix<float, kSquares, 1> values;  // without their mean
  Eigen::Matrix<float, kSquares, 2> slopes;  // likewise, per square
  float mean = 0;
};

// About `centre`, squares. Nothing at the image's edge, or where a square has no level.
std::optional<Texture> texture(const cv::Mat& levels, const Eigen::Vector2d& centre,
                               const Eigen::Matrix2d& slope) {
  constexpr float kMiddle = 0.5F * (kBlock - 1);
  const Eigen::Matrix2f A = slope.cast<float>();
  const Eigen::Vector2f reach = kMiddle * A.cwiseAbs().rowwise().sum();
  const Eigen::Vector2f lowest = centre.cast<float>() - reach;
  const Eigen::Vector2f highest = centre.cast<float>() + reach;
  const Eigen::Array2f end(static_cast<float>(levels.cols - 1),
                           static_cast<float>(levels.rows - 1));
  if (!(lowest.array() >= 0).all() || !(highest.array() < end).all()) return std::nullopt;
  Texture found;
  Eigen::Vector2f row = centre.cast<float>() - A * Eigen::Vector2f::Constant(kMiddle);
  for (int k = 0; k < kSquares; row += A.col(1)) {
    Eigen::Vector2f p = row;
    for (int u = 0; u < kBlock; ++u, ++k, p += A.col(0)) {
      // Sums of steps may fall short of the bounds by the last bit.
      const int x = std::clamp(static_cast<int>(p.x()), 0, levels.cols - 2);
      const int y = std::clamp(static_cast<int>(p.y()), 0, levels.rows - 2);
      const float fx = p.x() - static_cast<float>(x), fy = p.y() - static_cast<float>(y);
      const float* above = levels.ptr<float>(y) + x;
      const float* below = levels.ptr<float>(y + 1) + x;
      const float top = above[0] + fx * (above[1] - above[0]);
      const float bottom = below[0] + fx * (below[1] - below[0]);
      found.values(k) = top + fy * (bottom - top);
      found.slopes(k, 0) = (1 - fy) * (above[1] - above[0]) + fy * (below[1] - below[0]);
      found.slopes(k, 1) = bottom - top;
    }
  }
  found.mean = found.values.mean();
  if (!std::isfinite(found.mean)) return std::nullopt;
  found.values.array() -= found.mean;
  found.slopes.rowwise() -= found.slopes.colwise().mean().eval();
  return found;
}

// Of the grid: its squares are taken as they are.
std::optional<Texture> grid_block(const cv::Mat& levels, int column, int row) {
  Texture found;
  for (int k = 0; k < kSquares; ++k) {
    found.values(k) = levels.at<float>(kBlock * row + k / kBlock, kBlock * column + k % kBlock);
  }
  found.mean = found.values.mean();
  if (!std::isfinite(found.mean)) return std::nullopt;
  found.values.array() -= found.mean;
  return found;
}

struct Counterpart {
  Eigen::Vector2d pixel;
  double level = 0;
  double misfit = 0;  // RMS of what the textures differ
};

// Gauss-Newton from where the flow says; how far that may be wrong keeps a block without texture
// in its place.
std::optional<Counterpart> follow(const Texture& block, const Eigen::Vector2d& here,
                                  const Flow& flow, const Sight& sight, const BlockConfig& config) {
  constexpr double kNoisy_px = 4;  // side of a square that has config.pixel_noise
  const cv::Mat& levels = sight.levels;
  // Noise of a square, and the flow's error in squares: a smaller one has more of either.
  const double prior = std::pow(config.pixel_noise * kNoisy_px / config.flow_sigma_px, 2);
  const Eigen::Vector2d start = to_squares(flow.there(here), sight.side_px);
  const Eigen::Matrix2d slope = flow.slope(here);
  Eigen::Vector2d place = start;
  std::optional<Texture> found = texture(levels, place, slope);
  for (int k = 0; found && k < config.iterations; ++k) {
    const Eigen::Matrix2d H = (found->slopes.transpose() * found->slopes).cast<double>() +
                              prior * Eigen::Matrix2d::Identity();
    const Eigen::Vector2d b =
        (found->slopes.transpose() * (block.values - found->values)).cast<double>();
    place += H.inverse() * (b - prior * (place - start));
    if ((place - start).norm() > config.farthest_squares) return std::nullopt;
    found = texture(levels, place, slope);
  }
  if (!found) return std::nullopt;
  const double misfit = (block.values - found->values).norm() / kBlock;
  return Counterpart{to_pixels(place, sight.side_px), found->mean, misfit};
}

}  // namespace

int square_side(cv::Size image) {
  constexpr int kAcross = 160;
  return std::max(1, image.width / kAcross);
}

cv::Mat shown_squares(const cv::Mat& mask, int side_px) {
  cv::Mat shown(mask.rows / side_px, mask.cols / side_px, CV_8UC1, cv::Scalar(255));
  for (int y = 0; y < shown.rows; ++y)
    for (int x = 0; x < shown.cols; ++x) {
      const cv::Rect square(x * side_px, y * side_px, side_px, side_px);
      if (cv::countNonZero(mask(square)) < square.area()) shown.at<std::uint8_t>(y, x) = 0;
    }
  return shown;
}

cv::Mat square_means(const cv::Mat& image, int white, int side_px, const cv::Mat& shown) {
  cv::Mat levels = image.depth() == CV_8U ? means<std::uint8_t>(image, white, side_px)
                                          : means<std::uint16_t>(image, white, side_px);
  if (!shown.empty()) levels.setTo(std::numeric_limits<float>::quiet_NaN(), shown == 0);
  return levels;
}

std::vector<FieldDifference> compare_blocks(const Sight& before, const Sight& now,
                                            const BlockConfig& config) {
  std::vector<FieldDifference> found;
  std::vector<Motion> back = shared(now.tracks, before.tracks);
  if (before.levels.empty() || back.size() < static_cast<std::size_t>(config.fewest_tracks)) {
    return found;
  }
  const cv::Size image(now.side_px * now.levels.cols, now.side_px * now.levels.rows);
  const Flow to_now(shared(before.tracks, now.tracks), image, config);
  const Flow to_before(std::move(back), image, config);
  const int columns = now.levels.cols / kBlock, rows = now.levels.rows / kBlock;
  for (int i = 0; i < columns * rows; ++i) {
    const int column = i % columns, row = i / columns;
    const bool lies_now = (column + row) % 2 == 0;
    const auto block = grid_block(lies_now ? now.levels : before.levels, column, row);
    if (!block) continue;
    const Eigen::Vector2d here =
        to_pixels({kBlock * (column + 0.5) - 0.5, kBlock * (row + 0.5) - 0.5}, now.side_px);
    const auto other =
        follow(*block, here, lies_now ? to_before : to_now, lies_now ? before : now, config);
    if (!other) continue;
    FieldDifference difference{other->pixel, here, other->level, block->mean};
    if (!lies_now) difference = {here, other->pixel, block->mean, other->level};
    difference.noise = std::hypot(config.level_noise, config.misfit_noise * other->misfit);
    found.push_back(difference);
  }
  return found;
}

}  // namespace covey
