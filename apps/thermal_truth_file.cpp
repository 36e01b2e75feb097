// SPDX-License-Identifier: Apache-2.0
#include "apps/thermal_truth_file.h"

#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "apps/png_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

constexpr double kFieldInterval_s = 0.5;
constexpr double kCountsPerKelvin = 1000, kZeroCount = 32768;
constexpr char kHeader[] = "#timestamp [ns],black [K],white [K],shutter closed,field";

fs::path made(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder / "data", error);
  if (error) throw std::runtime_error((folder / "data").string() + ": " + error.message());
  return folder;
}

cv::Mat to_counts(const cv::Mat& pattern_k) {
  cv::Mat counts;
  in_truth_cells(pattern_k).convertTo(counts, CV_16U, kCountsPerKelvin, kZeroCount);
  return counts;
}

}  // namespace

ThermalTruthWriter::ThermalTruthWriter(const fs::path& mav0)
    : folder_(made(mav0 / kThermalTruthFolder)), csv_(folder_ / "data.csv", kHeader) {}

void ThermalTruthWriter::write(TimeNs stamp_ns, const ThermalTruth& truth) {
  std::string field = "-";
  if (stamp_ns >= next_field_ns_) {
    next_field_ns_ = stamp_ns + nanoseconds(kFieldInterval_s);
    field = std::to_string(stamp_ns) + ".png";
    write_png((folder_ / "data" / field).string(), to_counts(truth.pattern_k));
  }
  char numbers[96];
  std::snprintf(numbers, sizeof numbers, ",%.6f,%.6f,%d,", truth.black_k, truth.white_k,
                truth.shutter_closed ? 1 : 0);
  csv_.write_line(std::to_string(stamp_ns) + numbers + field);
}

void ThermalTruthWriter::close() { csv_.require_whole(); }

cv::Mat in_truth_cells(const cv::Mat& field) {
  cv::Mat cells;
  cv::resize(field, cells, field.size() / kTruthCell, 0, 0, cv::INTER_AREA);
  return cells;
}

std::optional<std::vector<ThermalTruthRecord>> read_thermal_truth(const fs::path& mav0) {
  const fs::path folder = mav0 / kThermalTruthFolder;
  if (!fs::exists(folder)) return std::nullopt;
  CsvReader reader(folder / "data.csv", CsvReader::Separator::kComma);
  std::vector<ThermalTruthRecord> records;
  while (reader.next()) {
    reader.require_columns(5, "stamp [ns], black [K], white [K], shutter closed, field");
    ThermalTruthRecord record;
    record.stamp_ns = reader.stamp_from_nanoseconds(0);
    record.black_k = reader.number(1);
    record.white_k = reader.number(2);
    record.shutter_closed = reader.integer(3) != 0;
    if (reader.text(4) != "-") record.field = folder / "data" / std::string(reader.text(4));
    if (!records.empty()) require_increasing(reader, records.back().stamp_ns, record.stamp_ns);
    if (record.white_k <= record.black_k) reader.fail("white is not warmer than black");
    records.push_back(std::move(record));
  }
  return records;
}

std::vector<TimeNs> field_stamps(const std::vector<ThermalTruthRecord>& truth) {
  std::vector<TimeNs> stamps;
  for (const ThermalTruthRecord& record : truth) {
    if (!record.field.empty()) stamps.push_back(record.stamp_ns);
  }
  return stamps;
}

cv::Mat read_true_field(const fs::path& file) {
  const cv::Mat counts = read_png(file.string());
  if (counts.type() != CV_16UC1) {
    throw std::runtime_error(file.string() + ": is not an image of 16 bits");
  }
  cv::Mat field;
  counts.convertTo(field, CV_32F, 1 / kCountsPerKelvin, -kZeroCount / kCountsPerKelvin);
  return field;
}

}  // namespace covey
