// SPDX-License-Identifier: Apache-2.0
//
// Lines of numbers, read fast and strictly: the file is loaded once, every complaint names
// file:line.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "apps/file_descriptor.h"
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

// A text file that is written line by line. Throws when it cannot be opened. A line for which there
// is no room (a full disk) is left out, which is warned of once; the file holds whole lines only,
// and goes on as soon as there is room again.
class LineWriter {
 public:
  explicit LineWriter(const std::filesystem::path& file, const std::string& header = "");
  void write_line(const std::string& line);

  // Of `write_line`, those that were left out.
  [[nodiscard]] std::int64_t lost_lines() const { return lost_lines_; }
  // Throws std::runtime_error if a line was left out.
  void require_whole() const;

 private:
  bool append(const std::string& text);
  bool take_back_torn_line();

  std::filesystem::path file_;
  std::string header_;
  FileDescriptor fd_;
  std::int64_t whole_bytes_ = 0;  // up to the end of the last line
  bool torn_ = false;             // a piece of a line stands after it
  bool warned_ = false;
  std::int64_t lost_lines_ = 0;
};

// Throws through `reader` when `stamp_ns` does not come after `previous_ns`.
void require_increasing(const CsvReader& reader, TimeNs previous_ns, TimeNs stamp_ns);

}  // namespace covey
