// SPDX-License-Identifier: Apache-2.0
#include "frontend/spatial_field.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "estimator/median.h"

namespace covey {
namespace {

// Of the kernel between `nodes` equally spaced nodes, one cell apart; ascending.
Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> kernel_modes(int nodes, double length_cells) {
  Eigen::MatrixXd K(nodes, nodes);
  for (int i = 0; i < nodes; ++i) {
    for (int j = 0; j < nodes; ++j) {
      const double d = (i - j) / length_cells;
      K(i, j) = std::exp(-0.5 * d * d);
    }
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(K);
}

// The eigenvectors of Ky (x) Kx are the Kronecker products of theirs.
Eigen::MatrixXd grid_modes(int columns, int rows, const SpatialConfig& config) {
  const auto along_x = kernel_modes(columns, config.length_cells);
  const auto along_y = kernel_modes(rows, config.length_cells);
  const double largest = along_x.eigenvalues().maxCoeff() * along_y.eigenvalues().maxCoeff();
  std::vector<Eigen::VectorXd> kept;
  for (int i = columns - 1; i >= 0; --i) {
    for (int j = rows - 1; j >= 0; --j) {
      const double eigenvalue = along_x.eigenvalues()(i) * along_y.eigenvalues()(j);
      if (eigenvalue < config.least_eigenvalue * largest) break;
      const Eigen::MatrixXd product =  // columns x rows: column by column is row by row of the grid
          along_x.eigenvectors().col(i) * along_y.eigenvectors().col(j).transpose();
      kept.emplace_back(config.sigma * std::sqrt(eigenvalue) * product.reshaped());
    }
  }
  Eigen::MatrixXd modes(columns * rows, static_cast<Eigen::Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k) modes.col(static_cast<Eigen::Index>(k)) = kept[k];
  return modes;
}

double median_size(const Eigen::VectorXd& values) {
  return median(std::vector<double>(values.data(), values.data() + values.size()));
}

// Patches that slid, or met a depth edge, count less: square roots of Cauchy's weights of what is
// left, in units of the noise, when the nuisance that fits best has been taken out.
Eigen::VectorXd weights(const Eigen::VectorXd& residuals, const Eigen::MatrixXd& nuisance,
                        double soft_sigmas) {
  constexpr int kRounds = 3;
  Eigen::VectorXd weight = Eigen::VectorXd::Ones(residuals.size());
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::MatrixXd A = weight.asDiagonal() * nuisance;
    const Eigen::VectorXd b = weight.asDiagonal() * residuals;
    const Eigen::VectorXd rest = (residuals - nuisance * A.householderQr().solve(b)).cwiseAbs();
    const double scale = soft_sigmas * std::max(1.48 * median_size(rest), 1.0);
    weight = (1 + (rest / scale).array().square()).rsqrt();
  }
  return weight;
}

}  // namespace

// Of the modes after and before, stacked.
struct SpatialField::Evidence {
  Eigen::MatrixXd information;
  Eigen::VectorXd vector;
};

SpatialField::SpatialField(const SpatialConfig& config, cv::Size image_size)
    : config_(config),
      image_size_(image_size),
      cell_px_(static_cast<double>(image_size.width) / config.cells_across),
      columns_(1 + config.cells_across),
      rows_(1 + static_cast<int>(std::ceil(image_size.height / cell_px_))),
      modes_(grid_modes(columns_, rows_, config)) {
  reset();
}

void SpatialField::reset(double share) {
  mean_.setZero(modes_.cols());
  information_.setIdentity(modes_.cols(), modes_.cols());
  information_ /= share * share;
  nodes_.setZero(modes_.rows());
}

SpatialField::Corner SpatialField::corner(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d cell = pixel / cell_px_;
  Corner corner;
  corner.x = std::clamp(static_cast<int>(cell.x()), 0, columns_ - 2);
  corner.y = std::clamp(static_cast<int>(cell.y()), 0, rows_ - 2);
  corner.fx = std::clamp(cell.x() - corner.x, 0.0, 1.0);
  corner.fy = std::clamp(cell.y() - corner.y, 0.0, 1.0);
  return corner;
}

Eigen::VectorXd SpatialField::modes_at(const Eigen::Vector2d& pixel) const {
  const Corner c = corner(pixel);
  const int node = c.y * columns_ + c.x;
  return ((1 - c.fy) * ((1 - c.fx) * modes_.row(node) + c.fx * modes_.row(node + 1)) +
          c.fy *
              ((1 - c.fx) * modes_.row(node + columns_) + c.fx * modes_.row(node + columns_ + 1)))
      .transpose();
}

double SpatialField::at(const Eigen::Vector2d& pixel) const {
  const Corner c = corner(pixel);
  const int node = c.y * columns_ + c.x;
  return (1 - c.fy) * ((1 - c.fx) * nodes_(node) + c.fx * nodes_(node + 1)) +
         c.fy * ((1 - c.fx) * nodes_(node + columns_) + c.fx * nodes_(node + columns_ + 1));
}

// to_level - from_level = a(to) m_after - a(from) m_before + offset + gain * level + noise.
SpatialField::Evidence SpatialField::evidence(
    double keep, const std::vector<FieldDifference>& differences) const {
  const auto rows = static_cast<Eigen::Index>(differences.size());
  const Eigen::Index modes = modes_.cols();
  Eigen::MatrixXd A(rows, 2 * modes), nuisance(rows, 2);
  Eigen::VectorXd y(rows), certainty(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const FieldDifference& d = differences[static_cast<std::size_t>(i)];
    A.row(i) << modes_at(d.to).transpose(), -modes_at(d.from).transpose();
    y(i) = d.to_level - d.from_level;
    certainty(i) = 1 / d.noise;
    nuisance.row(i) << 1, 0.5 * (d.to_level + d.from_level) - 0.5 * (at(d.to) + at(d.from));
  }
  const auto weigh = [&](const Eigen::VectorXd& weight) {
    A = weight.asDiagonal() * A;
    y = weight.asDiagonal() * y;
    nuisance = weight.asDiagonal() * nuisance;
  };
  weigh(certainty);
  const Eigen::VectorXd expected = keep * A.leftCols(modes) * mean_ + A.rightCols(modes) * mean_;
  weigh(weights(y - expected, nuisance, config_.soft_sigmas));
  const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(nuisance).householderQ() *
                            Eigen::MatrixXd::Identity(rows, 2);
  A -= Q * (Q.transpose() * A).eval();
  y -= Q * (Q.transpose() * y).eval();
  Evidence evidence{Eigen::MatrixXd::Zero(2 * modes, 2 * modes), A.transpose() * y};
  evidence.information.selfadjointView<Eigen::Lower>().rankUpdate(A.transpose());
  return evidence;
}

// m_after = keep m_before + w, cov(w) = 1 - keep^2: both are unknown until the evidence is in, then
// m_before is marginalised.
void SpatialField::update(double elapsed_s, const std::vector<FieldDifference>& differences) {
  constexpr std::size_t kFewest = 8;  // two of them are spent on gain and offset
  constexpr double kShortest_s = 1e-3;
  const double keep = std::exp(-std::max(elapsed_s, kShortest_s) / config_.wander_s);
  const double freshness = 1 / (1 - keep * keep);
  const Eigen::Index modes = modes_.cols();
  Evidence both{Eigen::MatrixXd::Zero(2 * modes, 2 * modes), Eigen::VectorXd::Zero(2 * modes)};
  if (differences.size() >= kFewest) both = evidence(keep, differences);
  both.vector.tail(modes) += information_ * mean_;
  both.information.bottomRightCorner(modes, modes) += information_;
  both.information.bottomRightCorner(modes, modes).diagonal().array() += freshness * keep * keep;
  both.information.bottomLeftCorner(modes, modes).diagonal().array() -= freshness * keep;
  both.information.topLeftCorner(modes, modes).diagonal().array() += freshness;

  const Eigen::LLT<Eigen::MatrixXd> before(both.information.bottomRightCorner(modes, modes));
  const Eigen::MatrixXd W = before.matrixL().solve(both.information.bottomLeftCorner(modes, modes));
  information_ = both.information.topLeftCorner(modes, modes).selfadjointView<Eigen::Lower>();
  information_ -= W.transpose() * W;
  const Eigen::VectorXd rest =
      both.vector.head(modes) - W.transpose() * before.matrixL().solve(both.vector.tail(modes));
  mean_ = information_.llt().solve(rest);
  nodes_ = (modes_ * mean_).cast<float>();
  nodes_.array() -= nodes_.mean();
}

cv::Mat SpatialField::image(double units_per_sigma) const {
  constexpr int kFraction = 16;       // bits behind the point
  constexpr float kMost = INT16_MAX;  // units
  cv::Mat field(image_size_, CV_16SC1);
  const Eigen::Map<const Eigen::MatrixXf> node_rows(nodes_.data(), columns_, rows_);
  const auto cell_px = static_cast<float>(cell_px_);
  Eigen::ArrayXf column(columns_);  // the nodes' row, interpolated between two rows
  for (int y = 0; y < field.rows; ++y) {
    const Corner c = corner({0, static_cast<double>(y)});
    const auto fy = static_cast<float>(c.fy);
    column = (1 - fy) * node_rows.col(c.y) + fy * node_rows.col(c.y + 1);
    column = (column * static_cast<float>(units_per_sigma)).max(-kMost).min(kMost);
    auto* out = field.ptr<std::int16_t>(y);
    for (int cell = 0, begin = 0, end = 0; cell + 1 < columns_; ++cell, begin = end) {
      const auto left = static_cast<float>(cell) * cell_px;
      const auto right = static_cast<float>(cell + 1) * cell_px;
      end = cell + 2 < columns_ ? std::min(field.cols, static_cast<int>(std::ceil(right)))
                                : field.cols;
      const float slope = (column(cell + 1) - column(cell)) / cell_px;
      const float start = column(cell) + slope * (static_cast<float>(begin) - left) + 0.5F;
      const auto step = static_cast<int>(slope * (1 << kFraction));
      int value = static_cast<int>(start * (1 << kFraction));
      for (int x = begin; x < end; ++x, value += step) {
        out[x] = static_cast<std::int16_t>(value >> kFraction);
      }
    }
  }
  return field;
}

}  // namespace covey
