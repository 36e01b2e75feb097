// SPDX-License-Identifier: Apache-2.0
//
// Lines of numbers, read fast and strictly: the file is loaded once, every complaint names
// file:line.
#pragma once

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

class CsvReader {
 public:
  enum class Separator { kComma, kSpace };

  // Throws when the file cannot be read.
  CsvReader(const std::filesystem::path& file, Separator separator);

  CsvReader(const CsvReader&) = delete;  // the fields point into the content
  CsvReader& operator=(const CsvReader&) = delete;

  // Moves on to the next line that is neither blank nor a comment (#). False at the end.
  [[nodiscard]] bool next();
  // The same without the moving on: "" at the end.
  [[nodiscard]] std::string_view peek() const;

  [[nodiscard]] std::size_t columns() const { return fields_.size(); }
  // Throws unless the line has at least `count` columns; `names` says which in the complaint.
  void require_columns(std::size_t count, const std::string& names) const;

  [[nodiscard]] std::string_view text(std::size_t column) const { return fields_.at(column); }
  [[nodiscard]] double number(std::size_t column) const;  // finite
  [[nodiscard]] std::int64_t integer(std::size_t column) const;
  [[nodiscard]] TimeNs stamp_from_nanoseconds(std::size_t column) const;
  [[nodiscard]] TimeNs stamp_from_seconds(std::size_t column) const;
  [[nodiscard]] Eigen::Vector3d vector3(std::size_t first_column) const;
  // Unit to within 1 %, returned normalised.
  [[nodiscard]] Eigen::Quaterniond quaternion(std::size_t w, std::size_t x, std::size_t y,
                                              std::size_t z) const;

  // Throws std::runtime_error: "file:line: what".
  [[noreturn]] void fail(const std::string& what) const;

 private:
  [[nodiscard]] std::string_view line_at(std::size_t begin) const;
  void split(std::string_view line);

  std::filesystem::path file_;
  Separator separator_;
  std::string content_;
  std::size_t position_ = 0;
  int line_number_ = 0;
  std::vector<std::string_view> fields_;
};

// A text file that is written line by line. Throws when it cannot be opened; `close` throws when a
// line was lost (a full disk).
class LineWriter {
 public:
  explicit LineWriter(const std::filesystem::path& file, const std::string& header = "");
  void write_line(const std::string& line);
  void close();

 private:
  std::filesystem::path file_;
  std::ofstream stream_;
};

// Throws through `reader` when `stamp_ns` does not come after `previous_ns`.
void require_increasing(const CsvReader& reader, TimeNs previous_ns, TimeNs stamp_ns);

}  // namespace covey
