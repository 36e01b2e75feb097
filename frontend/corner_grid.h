// SPDX-License-Identifier: Apache-2.0
//
// New corners where the image has none yet: FAST (Rosten and Drummond 2006) in the cells that want
// one, each cell with a threshold that follows its own contrast, best by Shi and Tomasi's
// eigenvalue.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct CornerConfig {
  double min_distance = 15;     // of a new corner from any track, px; in small images 1.2 cells
  int border = 12;              // no corner nearer to the edge of the image, px
  int start_threshold = 20;     // of FAST, grey levels; each cell adapts its own
  int min_threshold = 4;        // in cells of little contrast, grey levels
  int max_threshold = 40;       // in cells of much contrast, grey levels
  double min_eigenvalue = 2.0;  // of the mean structure tensor, (grey levels/px)^2
  int max_per_cell = 3;         // when other cells are empty
  int cells_per_image = 60;     // looked at in one image, except in the first
};

class CornerGrid {
 public:
  // Cells are sized so that `max_tracks` of them cover the image. `usable`: CV_8UC1, zero where no
  // corner may be; empty: nowhere.
  CornerGrid(const CornerConfig& config, cv::Size image_size, int max_tracks,
             const cv::Mat& usable = cv::Mat());

  // At most `wanted` corners, away from each other and from those that exist, best first.
  [[nodiscard]] std::vector<Eigen::Vector2d> detect(const cv::Mat& image,
                                                    const std::vector<Eigen::Vector2d>& existing,
                                                    int wanted);

 private:
  struct Cell {
    int threshold = 0;    // of FAST, grey levels
    int occupied = 0;     // tracks in it
    bool beyond = false;  // nothing but border
    bool barren = false;  // the last look found nothing
    std::int64_t last_look = 0;
  };
  struct Corner {
    cv::Point2f pixel;
    float eigenvalue = 0;
    int rank = 0;  // within its cell, counted on from the tracks there
  };

  void count_tracks(const std::vector<Eigen::Vector2d>& existing);
  [[nodiscard]] int cell_capacity() const;
  [[nodiscard]] std::vector<int> cells_to_look_at(int capacity, int wanted) const;
  [[nodiscard]] cv::Rect cell_area(int cell) const;
  void find_in_cell(const cv::Mat& image, Cell& cell, const cv::Rect& area,
                    const std::vector<Eigen::Vector2d>& existing, std::vector<Corner>& found) const;

  CornerConfig config_;
  cv::Size image_size_;
  cv::Mat usable_;
  int max_tracks_;
  double min_distance_ = 0;  // px
  int columns_ = 0, rows_ = 0;
  std::vector<Cell> cells_;  // row by row
  std::int64_t looks_ = 0;
};

}  // namespace covey
