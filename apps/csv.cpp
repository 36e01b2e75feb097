// SPDX-License-Identifier: Apache-2.0
#include "apps/csv.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <stdexcept>
#include <system_error>

#include "apps/whole_file.h"

namespace covey {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

// from_chars takes no leading '+'.
template <typename Number>
bool parse(std::string_view text, Number& value) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  return result.ec == std::errc() && result.ptr == text.data() + text.size();
}

// How much of it there was room for.
std::size_t write_some(int fd, const std::string& text) {
  std::size_t written = 0;
  while (written < text.size()) {
    const ssize_t bytes = ::write(fd, text.data() + written, text.size() - written);
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) break;
    written += static_cast<std::size_t>(bytes);
  }
  return written;
}

}  // namespace

CsvReader::CsvReader(const std::filesystem::path& file, Separator separator)
    : file_(file), separator_(separator), content_(read_whole_file(file)) {}

std::string_view CsvReader::line_at(std::size_t begin) const {
  const std::size_t end = std::min(content_.find('\n', begin), content_.size());
  return std::string_view(content_).substr(begin, end - begin);
}

bool CsvReader::next() {
  while (position_ < content_.size()) {
    const std::string_view raw = line_at(position_);
    position_ += raw.size() + 1;
    ++line_number_;
    const std::string_view line = trimmed(raw);
    if (line.empty() || line.front() == '#') continue;
    split(line);
    return true;
  }
  return false;
}

std::string_view CsvReader::peek() const {
  for (std::size_t begin = position_; begin < content_.size();) {
    const std::string_view raw = line_at(begin);
    const std::string_view line = trimmed(raw);
    if (!line.empty() && line.front() != '#') return line;
    begin += raw.size() + 1;
  }
  return {};
}

void CsvReader::split(std::string_view line) {
  fields_.clear();
  const bool comma = separator_ == Separator::kComma;
  for (std::size_t begin = 0; begin <= line.size();) {
    std::size_t end = begin;
    while (end < line.size() && (comma ? line[end] != ',' : !is_blank(line[end]))) ++end;
    const std::string_view field = trimmed(line.substr(begin, end - begin));
    // Several blanks in a row separate once; two commas in a row hold an empty field.
    if (comma || !field.empty()) fields_.push_back(field);
    begin = end + 1;
  }
}

void CsvReader::require_columns(std::size_t count, const std::string& names) const {
  if (columns() >= count) return;
  fail("the line has " + std::to_string(columns()) + " columns, expected " + std::to_string(count) +
       ": " + names);
}

double CsvReader::number(std::size_t column) const {
  double value = 0;
  if (!parse(text(column), value)) {
    fail("column " + std::to_string(column + 1) + " is not a number: '" +
         std::string(text(column)) + "'");
  }
  if (!std::isfinite(value)) {
    fail("column " + std::to_string(column + 1) + " is not finite: '" + std::string(text(column)) +
         "'; remove the line");
  }
  return value;
}

std::int64_t CsvReader::integer(std::size_t column) const {
  std::int64_t value = 0;
  if (!parse(text(column), value)) {
    fail("column " + std::to_string(column + 1) + " is not a whole number: '" +
         std::string(text(column)) + "'");
  }
  return value;
}

TimeNs CsvReader::stamp_from_nanoseconds(std::size_t column) const {
  TimeNs stamp_ns = 0;
  if (!parse(text(column), stamp_ns) || stamp_ns < 0) {
    fail("the stamp is not a whole number of nanoseconds: '" + std::string(text(column)) + "'");
  }
  return stamp_ns;
}

// Nineteen digits: a double would round a stamp of today to about 200 ns.
TimeNs CsvReader::stamp_from_seconds(std::size_t column) const {
  constexpr long double kLast = 9.2e9L;  // s; more nanoseconds do not fit into 64 bits
  long double seconds = 0;
  if (!parse(text(column), seconds) || !(seconds >= 0 && seconds < kLast)) {
    fail("the stamp is not a time in seconds: '" + std::string(text(column)) + "'");
  }
  return static_cast<TimeNs>(seconds * 1e9L + 0.5L);
}

Eigen::Vector3d CsvReader::vector3(std::size_t first_column) const {
  return {number(first_column), number(first_column + 1), number(first_column + 2)};
}

Eigen::Quaterniond CsvReader::quaternion(std::size_t w, std::size_t x, std::size_t y,
                                         std::size_t z) const {
  const Eigen::Quaterniond q(number(w), number(x), number(y), number(z));
  if (std::abs(q.norm() - 1) > 0.01) {
    fail("the quaternion's length is " + std::to_string(q.norm()) +
         ", not 1: are the columns in the right order?");
  }
  return q.normalized();
}

void CsvReader::fail(const std::string& what) const {
  throw std::runtime_error(file_.string() + ":" + std::to_string(line_number_) + ": " + what);
}

LineWriter::LineWriter(const std::filesystem::path& file, const std::string& header)
    : file_(file),
      header_(header.empty() ? "" : header + '\n'),
      fd_(::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0666)) {
  if (fd_.get() < 0) {
    throw std::runtime_error(file.string() + ": cannot be written: does its folder exist?");
  }
  append(header_);
}

// Handed over at once: what a program wrote is there, however it ends.
void LineWriter::write_line(const std::string& line) {
  const bool headless = whole_bytes_ == 0;  // there was no room for it, either
  if (!append((headless ? header_ : "") + line + '\n')) ++lost_lines_;
}

void LineWriter::require_whole() const {
  if (lost_lines_ == 0) return;
  throw std::runtime_error(file_.string() + ": " + std::to_string(lost_lines_) +
                           " lines could not be written: is the disk full?");
}

// All of it or nothing.
bool LineWriter::append(const std::string& text) {
  const std::size_t written = take_back_torn_line() ? write_some(fd_.get(), text) : 0;
  if (written == text.size()) {
    whole_bytes_ += static_cast<std::int64_t>(written);
    return true;
  }
  if (!warned_) {
    spdlog::warn("{}: cannot be written ({}): lines are left out until there is room",
                 file_.string(), std::generic_category().message(errno));
  }
  warned_ = true;
  torn_ = torn_ || written > 0;
  take_back_torn_line();
  return false;
}

// The next line would go on where it ends.
bool LineWriter::take_back_torn_line() {
  torn_ = torn_ && ::ftruncate(fd_.get(), whole_bytes_) != 0;
  return !torn_;
}

void require_increasing(const CsvReader& reader, TimeNs previous_ns, TimeNs stamp_ns) {
  if (stamp_ns == previous_ns) {
    reader.fail("stamp " + std::to_string(stamp_ns) + " ns appears twice; remove one line");
  }
  if (stamp_ns < previous_ns) {
    reader.fail("stamp " + std::to_string(stamp_ns) + " ns comes after " +
                std::to_string(previous_ns) + " ns; sort the lines by time");
  }
}

}  // namespace covey
