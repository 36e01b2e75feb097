// SPDX-License-Identifier: Apache-2.0
//
// Kalman updates from whitened rows (unit noise), each touching only a few columns of the state.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "estimator/state.h"

namespace covey {

// Which state columns the local columns of a Jacobian stand for, in order.
struct ColumnRange {
  int offset = 0, size = 0;
};
struct Columns {
  std::array<ColumnRange, 5> ranges{};
  int count = 0;
  void add(int offset, int size) {
    if (size > 0) ranges[static_cast<std::size_t>(count++)] = {offset, size};
  }
};

// Gathers rows against one prior and applies them at once. Memory is kept between updates.
class EkfUpdate {
 public:
  EkfUpdate(int max_rows, int state_capacity);

  void begin(const State& state);
  [[nodiscard]] bool fits(int rows) const { return rows_ + rows <= static_cast<int>(r_.size()); }
  // Adds rows r = H dx + n, n ~ N(0, I).
  void add(const State& state, const Eigen::Ref<const Eigen::MatrixXd>& H,
           const Eigen::Ref<const Eigen::VectorXd>& r, const Columns& columns);
  // Of the rows added last: their squared Mahalanobis distance (at most kMaxGatedRows rows) were
  // their noise of this variance, and how to take them out again when they are gated.
  static constexpr int kMaxGatedRows = 9;
  [[nodiscard]] double last_distance(double variance = 1) const;
  void drop_last();
  // False when the innovation covariance is not positive definite: nothing is changed then.
  [[nodiscard]] bool apply(State& state);

 private:
  struct Block {
    int row, rows;
    Columns columns;
  };
  // Adds H P H^T of the block with all rows up to it to the block's rows of S.
  template <typename Rows>
  void add_innovation(const Block& block, int first_row, Rows&& S) const;

  Eigen::MatrixXd H_;    // max_rows x widest local Jacobian
  Eigen::MatrixXd PHt_;  // state_capacity x max_rows
  Eigen::VectorXd r_;
  std::vector<Block> blocks_;
  int rows_ = 0, dimension_ = 0;
};

// Householder QR in place of [H r] (rows x columns+1): the first min(rows, columns) rows then hold
// all the information about the state (Mourikis and Roumeliotis, ICRA 2007, eq. 26..28). Returns
// their count.
int compress_rows(Eigen::Ref<Eigen::MatrixXd> H_and_r);

// Reflects [H_f | H | r] so that H_f becomes upper triangular: rows 3.. no longer depend on the
// feature (its left null space). In place; H and r are columns of one matrix.
void project_out_feature(Eigen::Ref<Eigen::Matrix<double, Eigen::Dynamic, 3>> H_f,
                         Eigen::Ref<Eigen::MatrixXd> H_and_r);

}  // namespace covey
