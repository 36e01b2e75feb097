// SPDX-License-Identifier: Apache-2.0
//
// The additive field that a thermal camera lays over its images: low-frequency, slowly wandering. A
// patch followed across the image shows it: its grey level changes by the difference of the field
// (Das, Matthies and Daftry, RA-L 2021, section IV). The field is a Gaussian process on a grid with
// a squared-exponential kernel. That kernel is a product of one along x and one along y, so its
// eigenvectors are products too; the few that matter are the unknowns, and observations are summed
// up in their normal equations.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct SpatialConfig {
  double cell_px = 32;        // px between the nodes of the grid
  double length_cells = 2.5;  // correlation length, cells
  double sigma = 0.5;         // standard deviation of the field, of that of the image
  double noise = 0.1;         // of one observed difference, of the image's standard deviation
  double memory_s = 5;        // s, time constant after which observations are forgotten
  double refresh_s = 0.2;     // s between two solutions
};

// The same patch in two images: where it was and its grey level, in the image's standard
// deviations.
struct FieldDifference {
  Eigen::Vector2d from = Eigen::Vector2d::Zero(), to = Eigen::Vector2d::Zero();  // px
  double from_level = 0, to_level = 0;
};

class SpatialField {
 public:
  SpatialField(const SpatialConfig& config, cv::Size image_size);

  // Of two images: patches seen in both. Whatever gain and offset lie between the two images does
  // not matter, it is projected out.
  void add(const std::vector<FieldDifference>& differences);
  void age(double elapsed_s);
  // The field that fits best to what was added and to the prior; its mean is zero.
  void solve();
  void reset();

  // Bilinear between the nodes, in the image's standard deviations.
  [[nodiscard]] double at(const Eigen::Vector2d& pixel) const;
  // CV_16SC1, in units of 1/`units_per_sigma` standard deviations.
  [[nodiscard]] cv::Mat image(double units_per_sigma) const;
  [[nodiscard]] bool empty() const { return nodes_.isZero(0); }

 private:
  struct Corner {
    int x = 0, y = 0;       // node to the left and above
    double fx = 0, fy = 0;  // 0..1 within the cell
  };
  [[nodiscard]] Corner corner(const Eigen::Vector2d& pixel) const;
  [[nodiscard]] Eigen::VectorXf modes_at(const Eigen::Vector2d& pixel) const;

  SpatialConfig config_;
  cv::Size image_size_;
  int columns_ = 0, rows_ = 0;   // of nodes
  Eigen::MatrixXf modes_;        // nodes (row by row) x modes, each scaled by its prior deviation
  Eigen::MatrixXf information_;  // modes x modes, lower triangle, without the prior
  Eigen::VectorXf evidence_;     // modes
  Eigen::VectorXf nodes_;        // the field, row by row
};

}  // namespace covey
