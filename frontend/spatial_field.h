// SPDX-License-Identifier: Apache-2.0
//
// The additive field that a thermal camera lays over its images: low-frequency, slowly wandering. A
// patch followed across the image shows it: its grey level changes by the difference of the field
// (Das, Matthies and Daftry, RA-L 2021, section IV). The field is a Gaussian process on a grid with
// a squared-exponential kernel. That kernel is a product of one along x and one along y, so its
// eigenvectors are products too; the few that matter are the unknowns m. In time each of them is an
// Ornstein-Uhlenbeck process, and a Kalman filter in information form follows them: between two
// sights a field that wanders with 25 s has changed by an eighth of itself within 0.2 s.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct SpatialConfig {
  int cells_across = 40;         // of the image: the grid's and the field's scale are the sensor's
  double length_cells = 5;       // correlation length, cells
  double sigma = 0.5;            // standard deviation of the field, of that of the image
  double corrected_share = 0.3;  // of it, left when the camera has looked at its shutter
  double wander_s = 25;          // s, time constant with which the field becomes another
  double refresh_s = 0.15;       // s between two sights
  double least_eigenvalue = 1e-3;  // of the largest; weaker modes are left out
  double soft_sigmas = 3;          // by which a difference may be off before it counts less
};

// The same piece of the scene in two images: where it was and its grey level, in the image's
// standard deviations.
struct FieldDifference {
  Eigen::Vector2d from = Eigen::Vector2d::Zero(), to = Eigen::Vector2d::Zero();  // px
  double from_level = 0, to_level = 0;
  double noise = 0.07;  // of the difference, standard deviation
};

class SpatialField {
 public:
  SpatialField(const SpatialConfig& config, cv::Size image_size);

  // Goes on by `elapsed_s` and takes in what pieces of the scene show that were seen before and
  // after. Whatever gain and offset lie between the two images does not matter, it is projected
  // out.
  void update(double elapsed_s, const std::vector<FieldDifference>& differences);
  // Nothing is known but that the field's deviation is `share` of the usual one.
  void reset(double share = 1);

  // Its mean is zero. Bilinear between the nodes, in the image's standard deviations.
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
  [[nodiscard]] Eigen::VectorXd modes_at(const Eigen::Vector2d& pixel) const;
  struct Evidence;
  [[nodiscard]] Evidence evidence(double keep,
                                  const std::vector<FieldDifference>& differences) const;

  SpatialConfig config_;
  cv::Size image_size_;
  double cell_px_ = 0;          // between the nodes
  int columns_ = 0, rows_ = 0;  // of nodes
  // Nodes (row by row) x modes, each scaled by its prior deviation.
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> modes_;
  Eigen::VectorXd mean_;         // of the modes
  Eigen::MatrixXd information_;  // modes x modes, inverse covariance; before anything is seen: 1
  Eigen::VectorXf nodes_;        // the field, row by row
};

}  // namespace covey
