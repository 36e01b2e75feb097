// SPDX-License-Identifier: Apache-2.0
#include "frontend/pixel_lag.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace covey {
namespace {

constexpr int kCell = 32;       // px between nodes
constexpr float kLongest = 14;  // px, of a path; what moves faster is taken for that
constexpr int kMargin = 16;     // px around the sharpened image, for what comes from outside

// Levels and paths are whole numbers of 16 bits: compilers then work on eight pixels at once. None
// of them overflows with paths up to kLongest.
constexpr int kPartsLog2 = 3, kParts = 1 << kPartsLog2;  // of a grey level
constexpr std::int16_t kMostParts = 8191;                // as far as a level goes, either way
constexpr int kOneLog2 = 15, kOne = 1 << kOneLog2;       // pixel: what parts of it are told in
// Of a pixel of a path, times a twelfth, as derivatives are twelve times too large.
constexpr int kPathLog2 = 11;
constexpr float kPathUnits = (1 << kPathLog2) * kParts / 12.0F;

// Flow of a resting point that the camera turns away from, per rad/s.
Eigen::Matrix<double, 2, 3> flow_of_turning(const CameraIntrinsics& camera,
                                            const Eigen::Vector2d& bearing) {
  Eigen::Matrix2d J;
  [[maybe_unused]] const Eigen::Vector2d pixel = project(camera, bearing, &J);
  const double x = bearing.x(), y = bearing.y();
  Eigen::Matrix<double, 2, 3> bearing_rate;  // of -rate x (x, y, 1), divided by depth
  bearing_rate << x * y, -1 - x * x, y, 1 + y * y, -x * y, -x;
  return J * bearing_rate;
}

// Between tracks, what rotation does not explain: the nearest tell most.
Eigen::Vector2d mean_velocity(const Eigen::Vector2d& pixel, const std::vector<TrackPlace>& tracks) {
  constexpr double kNear2 = 16 * 16;  // px2: nearer counts no more
  double total = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const TrackPlace& track : tracks) {
    const double near = 1 / ((track.place.pixel - pixel).squaredNorm() + kNear2);
    sum += near * near * track.velocity;
    total += near * near;
  }
  return total > 0 ? Eigen::Vector2d(sum / total) : sum;
}

Eigen::Vector2i in_units(const Eigen::Vector2f& pixels, float of_a_pixel) {
  return (of_a_pixel * pixels).array().round().cast<int>();
}

// A whole number that grows by `step` for each pixel.
struct Ramp {
  std::int16_t begin = 0, step = 0;
  Ramp(int begin_in, int step_in)
      : begin(static_cast<std::int16_t>(begin_in)), step(static_cast<std::int16_t>(step_in)) {}
  [[nodiscard]] std::int16_t at(int pixel) const {
    return static_cast<std::int16_t>(begin + static_cast<std::int16_t>(pixel) * step);
  }
};

// How many pixels on, `part` of a pixel that grows by `step` for each stays within one.
int pixels_within_one(int part, int step) {
  if (step > 0) return 1 + (kOne - 1 - part) / step;
  if (step < 0) return 1 + part / -step;
  return std::numeric_limits<int>::max();
}

// Of a row, `down` pixels above the next one, whose pixels move along `path` during one time
// constant, which grows by `step` for each pixel. Derivatives are right to the fourth order: those
// from next neighbours alone would leave a tenth of the lag in waves of 6 px.
void take_lag_out(const std::uint8_t* in, std::ptrdiff_t down, const Eigen::Vector2i& path,
                  const Eigen::Vector2i& step, int count, std::int16_t* out) {
  constexpr int kHalf = 1 << (kPathLog2 - 1);
  const Ramp path_x(path.x(), step.x()), path_y(path.y(), step.y());
  for (int x = 0; x < count; ++x) {
    const auto across_x =
        static_cast<std::int16_t>(8 * (in[x + 1] - in[x - 1]) - (in[x + 2] - in[x - 2]));
    const auto across_y = static_cast<std::int16_t>(8 * (in[x + down] - in[x - down]) -
                                                    (in[x + 2 * down] - in[x - 2 * down]));
    const auto lag = static_cast<std::int16_t>(
        (path_x.at(x) * across_x + path_y.at(x) * across_y + kHalf) >> kPathLog2);
    const auto level = static_cast<std::int16_t>(kParts * in[x] - lag);
    out[x] = std::min(std::max(level, static_cast<std::int16_t>(-kMostParts)), kMostParts);
  }
}

// (a b) / 2^16, rounded down: one instruction for a whole vector of them.
std::int16_t upper_half(std::int16_t a, std::int16_t b) {
  return static_cast<std::int16_t>((a * b) >> 16);
}

// `part` of the way from one level to another, `part` in units of kOne.
std::int16_t between(std::int16_t from, std::int16_t to, std::int16_t part) {
  const auto twice = static_cast<std::int16_t>(2 * (to - from));
  return static_cast<std::int16_t>(from + upper_half(twice, part));
}

// Bilinear, between two rows of levels; `part` of a pixel on, growing by `step` for each pixel.
void blend(const std::int16_t* top, const std::int16_t* bottom, const Eigen::Vector2i& part,
           const Eigen::Vector2i& step, int count, std::uint8_t* out) {
  const Ramp part_x(part.x(), step.x()), part_y(part.y(), step.y());
  for (int i = 0; i < count; ++i) {
    const std::int16_t above = between(top[i], top[i + 1], part_x.at(i));
    const std::int16_t below = between(bottom[i], bottom[i + 1], part_x.at(i));
    const auto rounded =
        static_cast<std::int16_t>(between(above, below, part_y.at(i)) + kParts / 2);
    const auto level = static_cast<std::int16_t>(rounded >> kPartsLog2);
    out[i] =
        static_cast<std::uint8_t>(std::min(std::max(level, std::int16_t{0}), std::int16_t{255}));
  }
}

// Written so that what is no number moves nothing.
Eigen::Vector2f no_longer_than_the_margin(const Eigen::Vector2f& path) {
  const float length = path.norm();
  return length > 0 ? Eigen::Vector2f(path * std::min(1.0F, kLongest / length))
                    : Eigen::Vector2f(Eigen::Vector2f::Zero());
}

}  // namespace

PixelLag::PixelLag(const CameraIntrinsics& camera, double line_delay_s)
    : columns_((camera.width + kCell - 1) / kCell + 1),
      rows_((camera.height + kCell - 1) / kCell + 1),
      line_delay_s_(line_delay_s),
      middle_row_(0.5 * (camera.height - 1)),
      velocities_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_),
                  Eigen::Vector2f::Zero()),
      flows_(velocities_),
      smears_(velocities_),
      moves_(velocities_),
      readout_(camera.height + 2 * kMargin, camera.width + 2 * kMargin, CV_16SC1, cv::Scalar(0)) {
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      Node node;
      node.pixel = kCell * Eigen::Vector2d(column, row);
      if (const auto bearing = unproject(camera, node.pixel)) {
        node.flow_rate = flow_of_turning(camera, *bearing);
      }
      nodes_.push_back(node);
    }
  }
}

void PixelLag::set_motion(const Turn& turn, const std::vector<TrackPlace>& tracks) {
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const Node& node = nodes_[i];
    const Eigen::Vector2d velocity = mean_velocity(node.pixel, tracks);
    // Until the row looks the camera turns at the mean of then and now.
    const Eigen::Vector3d rate = turn.rate + 0.5 * later_s(node.pixel.y()) * turn.acceleration;
    velocities_[i] = velocity.cast<float>();
    flows_[i] = (node.flow_rate * rate + velocity).cast<float>();
  }
}

Eigen::Vector2d PixelLag::between_nodes(const AtNodes& values, const Eigen::Vector2d& pixel) const {
  const Eigen::Array2d last(columns_ - 1, rows_ - 1);
  const Eigen::Array2d place = (pixel.array() / kCell).max(0.0).min(last - 1e-6);
  const Eigen::Array2d whole = place.floor(), part = place - whole;
  const Eigen::Vector2f* top = values.data() + static_cast<std::ptrdiff_t>(whole.y()) * columns_ +
                               static_cast<std::ptrdiff_t>(whole.x());
  const Eigen::Vector2f* bottom = top + columns_;
  const auto fx = static_cast<float>(part.x()), fy = static_cast<float>(part.y());
  const Eigen::Vector2f above = top[0] + fx * (top[1] - top[0]);
  const Eigen::Vector2f below = bottom[0] + fx * (bottom[1] - bottom[0]);
  return (above + fy * (below - above)).cast<double>();
}

Eigen::Vector2d PixelLag::flow(const Eigen::Vector2d& pixel) const {
  return between_nodes(flows_, pixel);
}

Eigen::Vector2d PixelLag::taken_too_far(const TrackPlace& track) const {
  const Eigen::Vector2d& pixel = track.place.pixel;
  return later_s(pixel.y()) * (track.velocity - between_nodes(velocities_, pixel));
}

void PixelLag::set_paths(double time_constant_s) {
  const auto time_constant = static_cast<float>(time_constant_s);
  for (std::size_t i = 0; i < flows_.size(); ++i) {
    const Eigen::Vector2f& flow = flows_[i];
    // The row that looks is not the one in which it is at the stamp.
    const double towards = std::max(0.5, 1 - line_delay_s_ * static_cast<double>(flow.y()));
    const double until_read_s = (time_constant_s + later_s(nodes_[i].pixel.y())) / towards;
    smears_[i] = no_longer_than_the_margin(time_constant * flow);
    moves_[i] = no_longer_than_the_margin(static_cast<float>(until_read_s) * flow);
  }
}

// Part of a row between two columns of nodes: the path changes linearly along it.
struct PixelLag::Stretch {
  int begin = 0, end = 0;  // columns of the image
  Eigen::Vector2f path;    // at `begin`, px
  Eigen::Vector2f slope;   // px/px
};

template <typename Use>
void PixelLag::for_each_stretch(const AtNodes& paths, int y, Use use) const {
  const Eigen::Vector2f* above = paths.data() + static_cast<std::ptrdiff_t>(y / kCell) * columns_;
  const auto at = [&](int column) {
    const Eigen::Vector2f *top = above + column, *bottom = top + columns_;
    return Eigen::Vector2f(*top + static_cast<float>(y % kCell) / kCell * (*bottom - *top));
  };
  const int width = readout_.cols - 2 * kMargin;
  Eigen::Vector2f path = at(0);
  for (int column = 0; column * kCell < width; ++column) {
    const Eigen::Vector2f next = at(column + 1);
    const int begin = column * kCell;
    use(Stretch{begin, std::min(begin + kCell, width), path, (next - path) / kCell});
    path = next;
  }
}

// Into `readout_`.
void PixelLag::sharpen(const cv::Mat& grey) {
  constexpr int kReach = 2;  // px
  const auto down = static_cast<std::ptrdiff_t>(grey.step);
  for (int y = 0; y < grey.rows; ++y) {
    const std::uint8_t* in = grey.ptr<std::uint8_t>(y);
    auto* out = readout_.ptr<std::int16_t>(y + kMargin) + kMargin;
    for (int x = 0; x < grey.cols; ++x) out[x] = static_cast<std::int16_t>(kParts * in[x]);
    if (y < kReach || y >= grey.rows - kReach) continue;
    for_each_stretch(smears_, y, [&](const Stretch& stretch) {
      const int first = std::max(stretch.begin, kReach);
      const int end = std::min(stretch.end, grey.cols - kReach);
      const Eigen::Vector2i step = in_units(stretch.slope, kPathUnits);
      const Eigen::Vector2i path =
          in_units(stretch.path, kPathUnits) + (first - stretch.begin) * step;
      take_lag_out(in + first, down, path, step, end - first, out + first);
    });
  }
}

void PixelLag::extend_edges() {
  const int right = readout_.cols - kMargin, bottom = readout_.rows - kMargin;
  for (int y = kMargin; y < bottom; ++y) {
    auto* row = readout_.ptr<std::int16_t>(y);
    std::fill(row, row + kMargin, row[kMargin]);
    std::fill(row + right, row + readout_.cols, row[right - 1]);
  }
  for (int i = 0; i < kMargin; ++i) {
    readout_.row(kMargin).copyTo(readout_.row(i));
    readout_.row(bottom - 1).copyTo(readout_.row(bottom + i));
  }
}

cv::Mat PixelLag::taken_out(const cv::Mat& grey, double time_constant_s) {
  set_paths(time_constant_s);
  sharpen(grey);
  extend_edges();
  cv::Mat still(grey.size(), CV_8UC1);
  const auto width = static_cast<std::ptrdiff_t>(readout_.step1());
  const std::int16_t* origin = readout_.ptr<std::int16_t>(kMargin) + kMargin;
  for (int y = 0; y < grey.rows; ++y) {
    auto* out = still.ptr<std::uint8_t>(y);
    for_each_stretch(moves_, y, [&](const Stretch& stretch) {
      const Eigen::Vector2i step = in_units(stretch.slope, kOne);
      Eigen::Vector2i path = in_units(stretch.path, kOne);
      for (int x = stretch.begin; x < stretch.end;) {
        const Eigen::Vector2i whole(path.x() >> kOneLog2, path.y() >> kOneLog2);
        const Eigen::Vector2i part = path - kOne * whole;
        const int count = std::min({stretch.end - x, pixels_within_one(part.x(), step.x()),
                                    pixels_within_one(part.y(), step.y())});
        const std::int16_t* top = origin + (y + whole.y()) * width + x + whole.x();
        blend(top, top + width, part, step, count, out + x);
        path += count * step;
        x += count;
      }
    });
  }
  return still;
}

}  // namespace covey
