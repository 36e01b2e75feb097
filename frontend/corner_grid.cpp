// SPDX-License-Identifier: Apache-2.0
#include "frontend/corner_grid.h"

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace covey {
namespace {

constexpr int kFastRadius = 3;             // px around a pixel that FAST looks at
constexpr int kTensorRadius = 4;           // px, structure tensor
constexpr std::size_t kMaxCandidates = 6;  // of a cell, strongest FAST response first
// FAST corners in a cell: with fewer its threshold falls, with more it rises.
constexpr std::size_t kScarce = 3;
constexpr std::size_t kCrowded = 25;

// Smaller eigenvalue of the mean structure tensor around a pixel (Shi and Tomasi 1994).
float smaller_eigenvalue(const cv::Mat& image, const cv::Point& centre) {
  int xx = 0, xy = 0, yy = 0;
  for (int y = centre.y - kTensorRadius; y <= centre.y + kTensorRadius; ++y) {
    const std::uint8_t* above = image.ptr<std::uint8_t>(y - 1);
    const std::uint8_t* here = image.ptr<std::uint8_t>(y);
    const std::uint8_t* below = image.ptr<std::uint8_t>(y + 1);
    for (int x = centre.x - kTensorRadius; x <= centre.x + kTensorRadius; ++x) {
      const int gx = here[x + 1] - here[x - 1];  // twice the gradient
      const int gy = below[x] - above[x];
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  constexpr int kSide = 2 * kTensorRadius + 1;
  const float half_trace = 0.5f * static_cast<float>(xx + yy);
  const float half_difference = 0.5f * static_cast<float>(xx - yy);
  return (half_trace - std::hypot(half_difference, static_cast<float>(xy))) / (4 * kSide * kSide);
}

bool far_from_all(const std::vector<Eigen::Vector2d>& others, const cv::Point2f& pixel,
                  double distance) {
  const Eigen::Vector2d p(pixel.x, pixel.y);
  return std::none_of(others.begin(), others.end(), [&](const Eigen::Vector2d& other) {
    return (other - p).squaredNorm() < distance * distance;
  });
}

// So that two drones mean the same point by the same corner.
std::vector<Eigen::Vector2d> refine(const cv::Mat& image, const std::vector<cv::Point2f>& corners) {
  if (corners.empty()) return {};
  std::vector<cv::Point2f> refined = corners;
  const cv::TermCriteria until(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 10, 0.05);
  cv::cornerSubPix(image, refined, {4, 4}, {-1, -1}, until);
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(refined.size());
  for (const cv::Point2f& p : refined) pixels.emplace_back(p.x, p.y);
  return pixels;
}

}  // namespace

CornerGrid::CornerGrid(const CornerConfig& config, cv::Size image_size, int max_tracks,
                       const cv::Mat& usable)
    : config_(config), image_size_(image_size), usable_(usable), max_tracks_(max_tracks) {
  const double side = std::sqrt(static_cast<double>(image_size.area()) / std::max(1, max_tracks));
  columns_ = std::max(1, static_cast<int>(std::lround(image_size.width / side)));
  rows_ = std::max(1, static_cast<int>(std::lround(image_size.height / side)));
  constexpr double kCells = 1.2;  // apart at most: else so many tracks have no room
  min_distance_ = std::min(config.min_distance, kCells * side);
  Cell fresh;
  fresh.threshold = config.start_threshold;
  cells_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), fresh);
  for (int i = 0; i < columns_ * rows_; ++i) {
    cells_[static_cast<std::size_t>(i)].beyond = cell_area(i).empty();
  }
}

int CornerGrid::cell_capacity() const {
  const auto barren = std::count_if(cells_.begin(), cells_.end(), [](const Cell& cell) {
    return cell.beyond || (cell.barren && cell.occupied == 0);
  });
  const int fertile = std::max(1, static_cast<int>(cells_.size()) - static_cast<int>(barren));
  return std::clamp((max_tracks_ + fertile - 1) / fertile, 1, config_.max_per_cell);
}

cv::Rect CornerGrid::cell_area(int cell) const {
  const int column = cell % columns_, row = cell / columns_;
  const cv::Point from(column * image_size_.width / columns_, row * image_size_.height / rows_);
  const cv::Point to((column + 1) * image_size_.width / columns_,
                     (row + 1) * image_size_.height / rows_);
  const cv::Rect allowed(config_.border, config_.border, image_size_.width - 2 * config_.border,
                         image_size_.height - 2 * config_.border);
  return cv::Rect(from, to) & allowed;
}

void CornerGrid::find_in_cell(const cv::Mat& image, Cell& cell, const cv::Rect& area,
                              const std::vector<Eigen::Vector2d>& existing,
                              std::vector<Corner>& found) const {
  const cv::Rect looked_at(area.x - kFastRadius, area.y - kFastRadius, area.width + 2 * kFastRadius,
                           area.height + 2 * kFastRadius);
  std::vector<cv::KeyPoint> keypoints;
  for (;;) {
    cv::FAST(image(looked_at), keypoints, cell.threshold, true);
    if (keypoints.size() >= kScarce || cell.threshold <= config_.min_threshold) break;
    cell.threshold = std::max(cell.threshold / 2, config_.min_threshold);
  }
  if (keypoints.size() > kCrowded) {
    cell.threshold = std::min(cell.threshold * 5 / 4 + 1, config_.max_threshold);
  }

  const auto stronger = [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    return a.response > b.response;
  };
  std::stable_sort(keypoints.begin(), keypoints.end(), stronger);
  std::vector<Corner> candidates;
  for (const cv::KeyPoint& keypoint : keypoints) {
    if (candidates.size() == kMaxCandidates) break;
    const cv::Point pixel(looked_at.x + static_cast<int>(keypoint.pt.x),
                          looked_at.y + static_cast<int>(keypoint.pt.y));
    if (!usable_.empty() && usable_.at<std::uint8_t>(pixel) == 0) continue;
    if (!far_from_all(existing, pixel, min_distance_)) continue;
    const float eigenvalue = smaller_eigenvalue(image, pixel);
    if (eigenvalue >= config_.min_eigenvalue) candidates.push_back({pixel, eigenvalue, 0});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Corner& a, const Corner& b) { return a.eigenvalue > b.eigenvalue; });
  cell.barren = candidates.empty();
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    candidates[i].rank = cell.occupied + static_cast<int>(i);
    found.push_back(candidates[i]);
  }
}

void CornerGrid::count_tracks(const std::vector<Eigen::Vector2d>& existing) {
  for (Cell& cell : cells_) cell.occupied = 0;
  for (const Eigen::Vector2d& pixel : existing) {
    const int column = static_cast<int>(pixel.x()) * columns_ / image_size_.width;
    const int row = static_cast<int>(pixel.y()) * rows_ / image_size_.height;
    const int cell = std::clamp(row, 0, rows_ - 1) * columns_ + std::clamp(column, 0, columns_ - 1);
    ++cells_[static_cast<std::size_t>(cell)].occupied;
  }
}

// Emptiest first, among them the one not looked at for longest: what does not fit into this image's
// budget comes next. A barren cell waits like one that holds a track already.
std::vector<int> CornerGrid::cells_to_look_at(int capacity, int wanted) const {
  const auto cell = [&](int index) -> const Cell& {
    return cells_[static_cast<std::size_t>(index)];
  };
  std::vector<int> order;
  bool first_image = true;
  for (int i = 0; i < columns_ * rows_; ++i) {
    if (!cell(i).beyond && cell(i).occupied < capacity) order.push_back(i);
    first_image = first_image && cell(i).last_look == 0;
  }
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    const int full_a = cell(a).occupied + (cell(a).barren ? 1 : 0);
    const int full_b = cell(b).occupied + (cell(b).barren ? 1 : 0);
    return full_a != full_b ? full_a < full_b : cell(a).last_look < cell(b).last_look;
  });
  const int budget = std::min(config_.cells_per_image, 2 * wanted);
  const auto looked_at = first_image ? order.size() : static_cast<std::size_t>(budget);
  order.resize(std::min(order.size(), looked_at));
  return order;
}

std::vector<Eigen::Vector2d> CornerGrid::detect(const cv::Mat& image,
                                                const std::vector<Eigen::Vector2d>& existing,
                                                int wanted) {
  count_tracks(existing);
  const int capacity = cell_capacity();
  const std::vector<int> order = cells_to_look_at(capacity, wanted);
  ++looks_;
  std::vector<Corner> found;
  for (const int index : order) {
    Cell& cell = cells_[static_cast<std::size_t>(index)];
    cell.last_look = looks_;
    find_in_cell(image, cell, cell_area(index), existing, found);
  }
  // One for every cell before a second one for any: the spread counts more than the contrast.
  std::stable_sort(found.begin(), found.end(), [](const Corner& a, const Corner& b) {
    return a.rank != b.rank ? a.rank < b.rank : a.eigenvalue > b.eigenvalue;
  });
  std::vector<cv::Point2f> chosen;
  std::vector<Eigen::Vector2d> chosen_places;
  for (const Corner& corner : found) {
    if (static_cast<int>(chosen.size()) >= wanted) break;
    if (corner.rank >= capacity) continue;
    if (!far_from_all(chosen_places, corner.pixel, min_distance_)) continue;
    chosen.push_back(corner.pixel);
    chosen_places.emplace_back(corner.pixel.x, corner.pixel.y);
  }
  return refine(image, chosen);
}

}  // namespace covey
