// SPDX-License-Identifier: Apache-2.0
#include "estimator/ekf_update.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cassert>
#include <cmath>

namespace covey {

EkfUpdate::EkfUpdate(int max_rows, int state_capacity)
    : H_(max_rows, state_capacity), PHt_(state_capacity, max_rows), r_(max_rows) {}

void EkfUpdate::begin(const State& state) {
  blocks_.clear();
  rows_ = 0;
  dimension_ = state.dimension();
}

void EkfUpdate::add(const State& state, const Eigen::Ref<const Eigen::MatrixXd>& H,
                    const Eigen::Ref<const Eigen::VectorXd>& r, const Columns& columns) {
  const int m = static_cast<int>(H.rows());
  assert(fits(m) && state.dimension() == dimension_);
  const auto P = state.covariance();
  auto PHt = PHt_.block(0, rows_, dimension_, m);
  PHt.setZero();
  int local = 0;
  for (int i = 0; i < columns.count; ++i) {
    const ColumnRange& range = columns.ranges[static_cast<std::size_t>(i)];
    PHt.noalias() +=
        P.middleCols(range.offset, range.size) * H.middleCols(local, range.size).transpose();
    local += range.size;
  }
  H_.block(rows_, 0, m, local) = H.leftCols(local);
  r_.segment(rows_, m) = r;
  blocks_.push_back({rows_, m, columns});
  rows_ += m;
}

template <typename Rows>
void EkfUpdate::add_innovation(const Block& block, int first_row, Rows&& S) const {
  int local = 0;
  for (int i = 0; i < block.columns.count; ++i) {
    const ColumnRange& range = block.columns.ranges[static_cast<std::size_t>(i)];
    S.noalias() += H_.block(block.row, local, block.rows, range.size) *
                   PHt_.block(range.offset, first_row, range.size, S.cols());
    local += range.size;
  }
}

double EkfUpdate::last_distance(double variance) const {
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                               kMaxGatedRows, kMaxGatedRows>;
  const Block& last = blocks_.back();
  assert(last.rows <= kMaxGatedRows);
  Square S = variance * Square::Identity(last.rows, last.rows);
  add_innovation(last, last.row, S);
  const auto r = r_.segment(last.row, last.rows);
  return r.dot(S.selfadjointView<Eigen::Lower>().ldlt().solve(r));
}

void EkfUpdate::drop_last() {
  rows_ = blocks_.back().row;
  blocks_.pop_back();
}

bool EkfUpdate::apply(State& state) {
  if (rows_ == 0) return true;
  auto PHt = PHt_.topLeftCorner(dimension_, rows_);
  Eigen::MatrixXd S = Eigen::MatrixXd::Identity(rows_, rows_);
  // Rows of S up to and including each block's own columns: the lower triangle.
  for (const Block& block : blocks_) {
    add_innovation(block, 0, S.block(block.row, 0, block.rows, block.row + block.rows));
  }
  const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> cholesky(S);
  if (cholesky.info() != Eigen::Success) return false;
  const Eigen::VectorXd whitened = cholesky.matrixL().solve(r_.head(rows_));
  cholesky.matrixU().solveInPlace<Eigen::OnTheRight>(PHt);  // W = P H^T L^-T
  const Eigen::VectorXd dx = PHt * whitened;
  state.correct(dx, PHt);
  return true;
}

int compress_rows(Eigen::Ref<Eigen::MatrixXd> H_and_r) {
  const int rows = static_cast<int>(H_and_r.rows());
  const int columns = static_cast<int>(H_and_r.cols()) - 1;
  if (rows <= columns) return rows;
  // The last column rides along: after the factorisation it holds Q^T r.
  const Eigen::HouseholderQR<Eigen::Ref<Eigen::MatrixXd>> qr(H_and_r);
  for (int column = 0; column < columns; ++column) {
    H_and_r.col(column).segment(column + 1, columns - column - 1).setZero();
  }
  return columns;
}

void project_out_feature(Eigen::Ref<Eigen::Matrix<double, Eigen::Dynamic, 3>> H_f,
                         Eigen::Ref<Eigen::MatrixXd> H_and_r) {
  const int rows = static_cast<int>(H_f.rows());
  for (int j = 0; j < std::min(3, rows - 1); ++j) {
    const int m = rows - j;
    Eigen::VectorXd v = H_f.col(j).tail(m);
    const double norm = v.norm();
    if (norm == 0) continue;
    v(0) += v(0) > 0 ? norm : -norm;
    const double beta = 2 / v.squaredNorm();
    auto rest = H_f.bottomRightCorner(m, 3 - j);
    rest -= (beta * v) * (v.transpose() * rest).eval();
    auto below = H_and_r.bottomRows(m);
    below -= (beta * v) * (v.transpose() * below).eval();
  }
}

}  // namespace covey
