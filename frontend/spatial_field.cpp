// SPDX-License-Identifier: Apache-2.0
#include "frontend/spatial_field.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace covey {
namespace {

constexpr double kLeastEigenvalue = 1e-3;  // of the largest; weaker modes are left out

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
Eigen::MatrixXf grid_modes(int columns, int rows, const SpatialConfig& config) {
  const auto along_x = kernel_modes(columns, config.length_cells);
  const auto along_y = kernel_modes(rows, config.length_cells);
  const double largest = along_x.eigenvalues().maxCoeff() * along_y.eigenvalues().maxCoeff();
  std::vector<Eigen::VectorXf> kept;
  for (int i = columns - 1; i >= 0; --i) {
    for (int j = rows - 1; j >= 0; --j) {
      const double eigenvalue = along_x.eigenvalues()(i) * along_y.eigenvalues()(j);
      if (eigenvalue < kLeastEigenvalue * largest) break;
      const Eigen::MatrixXd product =  // columns x rows: column by column is row by row of the grid
          along_x.eigenvectors().col(i) * along_y.eigenvectors().col(j).transpose();
      kept.emplace_back(config.sigma * std::sqrt(eigenvalue) * product.reshaped().cast<float>());
    }
  }
  Eigen::MatrixXf modes(columns * rows, static_cast<Eigen::Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k) modes.col(static_cast<Eigen::Index>(k)) = kept[k];
  return modes;
}

}  // namespace

SpatialField::SpatialField(const SpatialConfig& config, cv::Size image_size)
    : config_(config),
      image_size_(image_size),
      columns_(1 + static_cast<int>(std::ceil(image_size.width / config.cell_px))),
      rows_(1 + static_cast<int>(std::ceil(image_size.height / config.cell_px))),
      modes_(grid_modes(columns_, rows_, config)) {
  reset();
}

void SpatialField::reset() {
  information_.setZero(modes_.cols(), modes_.cols());
  evidence_.setZero(modes_.cols());
  nodes_.setZero(modes_.rows());
}

SpatialField::Corner SpatialField::corner(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d cell = pixel / config_.cell_px;
  Corner corner;
  corner.x = std::clamp(static_cast<int>(cell.x()), 0, columns_ - 2);
  corner.y = std::clamp(static_cast<int>(cell.y()), 0, rows_ - 2);
  corner.fx = std::clamp(cell.x() - corner.x, 0.0, 1.0);
  corner.fy = std::clamp(cell.y() - corner.y, 0.0, 1.0);
  return corner;
}

Eigen::VectorXf SpatialField::modes_at(const Eigen::Vector2d& pixel) const {
  const Corner c = corner(pixel);
  const int node = c.y * columns_ + c.x;
  const auto fx = static_cast<float>(c.fx), fy = static_cast<float>(c.fy);
  return ((1 - fy) * ((1 - fx) * modes_.row(node) + fx * modes_.row(node + 1)) +
          fy * ((1 - fx) * modes_.row(node + columns_) + fx * modes_.row(node + columns_ + 1)))
      .transpose();
}

double SpatialField::at(const Eigen::Vector2d& pixel) const {
  const Corner c = corner(pixel);
  const int node = c.y * columns_ + c.x;
  return (1 - c.fy) * ((1 - c.fx) * nodes_(node) + c.fx * nodes_(node + 1)) +
         c.fy * ((1 - c.fx) * nodes_(node + columns_) + c.fx * nodes_(node + columns_ + 1));
}

void SpatialField::add(const std::vector<FieldDifference>& differences) {
  constexpr std::size_t kFewest = 8;  // two of them are spent on gain and offset
  if (differences.size() < kFewest) return;
  const auto rows = static_cast<Eigen::Index>(differences.size());
  Eigen::MatrixXf A(rows, modes_.cols());
  Eigen::VectorXf y(rows);
  Eigen::MatrixXf nuisance(rows, 2);  // offset, gain
  for (Eigen::Index i = 0; i < rows; ++i) {
    const FieldDifference& d = differences[static_cast<std::size_t>(i)];
    A.row(i) = (modes_at(d.to) - modes_at(d.from)).transpose();
    y(i) = static_cast<float>(d.to_level - d.from_level);
    const double level = 0.5 * (d.to_level + d.from_level) - 0.5 * (at(d.to) + at(d.from));
    nuisance.row(i) << 1, static_cast<float>(level);
  }
  // A patch that slid, or met a depth edge: Cauchy's weight against what the prior allows.
  for (Eigen::Index i = 0; i < rows; ++i) {
    const FieldDifference& d = differences[static_cast<std::size_t>(i)];
    const double surprise = (y(i) - at(d.to) + at(d.from)) / (2 * config_.sigma);
    const auto weight =
        static_cast<float>(1 / (config_.noise * std::sqrt(1 + surprise * surprise)));
    A.row(i) *= weight;
    y(i) *= weight;
    nuisance.row(i) *= weight;
  }
  const Eigen::MatrixXf Q = Eigen::HouseholderQR<Eigen::MatrixXf>(nuisance).householderQ() *
                            Eigen::MatrixXf::Identity(rows, 2);
  A -= Q * (Q.transpose() * A).eval();
  y -= Q * (Q.transpose() * y).eval();
  information_.selfadjointView<Eigen::Lower>().rankUpdate(A.transpose());
  evidence_ += A.transpose() * y;
}

void SpatialField::age(double elapsed_s) {
  const auto keep = static_cast<float>(std::exp(-elapsed_s / config_.memory_s));
  information_ *= keep;
  evidence_ *= keep;
}

void SpatialField::solve() {
  Eigen::MatrixXf A = information_;
  A.diagonal().array() += 1;  // the prior: modes carry their deviation
  nodes_ = modes_ * A.selfadjointView<Eigen::Lower>().llt().solve(evidence_);
  nodes_.array() -= nodes_.mean();
}

cv::Mat SpatialField::image(double units_per_sigma) const {
  cv::Mat field(image_size_, CV_16SC1);
  const Eigen::Map<const Eigen::MatrixXf> node_rows(nodes_.data(), columns_, rows_);
  Eigen::VectorXf column(columns_);  // the nodes' row, interpolated between two rows
  for (int y = 0; y < field.rows; ++y) {
    const Corner c = corner({0, static_cast<double>(y)});
    const auto fy = static_cast<float>(c.fy);
    column = (1 - fy) * node_rows.col(c.y) + fy * node_rows.col(c.y + 1);
    column *= static_cast<float>(units_per_sigma);
    auto* out = field.ptr<std::int16_t>(y);
    const auto step = static_cast<float>(1 / config_.cell_px);
    for (int x = 0; x < field.cols; ++x) {
      const float cell = static_cast<float>(x) * step;
      const int left = static_cast<int>(cell);
      const float value =
          column(left) + (cell - static_cast<float>(left)) * (column(left + 1) - column(left));
      out[x] = cv::saturate_cast<std::int16_t>(value);
    }
  }
  return field;
}

}  // namespace covey
