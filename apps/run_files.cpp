// SPDX-License-Identifier: Apache-2.0
#include "apps/run_files.h"

#include <cstdio>
#include <iterator>
#include <opencv2/imgproc.hpp>
#include <string>
#include <string_view>

#include "apps/whole_file.h"

namespace covey {
namespace {

// The columns of both files, in the order they are written.
struct TimeColumn {
  const char* name;
  double TimingRecord::*ms;
};
constexpr TimeColumn kTimeColumns[] = {
    {"read_ms", &TimingRecord::read_ms},           {"thermal_ms", &TimingRecord::thermal_ms},
    {"track_ms", &TimingRecord::track_ms},         {"describe_ms", &TimingRecord::describe_ms},
    {"place_ms", &TimingRecord::place_ms},         {"match_ms", &TimingRecord::match_ms},
    {"propagate_ms", &TimingRecord::propagate_ms}, {"msckf_ms", &TimingRecord::msckf_ms},
    {"slam_ms", &TimingRecord::slam_ms},           {"peer_ms", &TimingRecord::peer_ms},
    {"total_ms", &TimingRecord::total_ms},
};

template <typename Record>
struct CountColumn {
  const char* name;
  std::int64_t Record::*count;
};
constexpr CountColumn<TimingRecord> kTimingCounts[] = {
    {"tracks", &TimingRecord::tracks},           {"slam_features", &TimingRecord::slam_features},
    {"clones", &TimingRecord::clones},           {"msckf_used", &TimingRecord::msckf_used},
    {"msckf_gated", &TimingRecord::msckf_gated}, {"slam_used", &TimingRecord::slam_used},
    {"slam_gated", &TimingRecord::slam_gated},
};
constexpr CountColumn<LinkRecord> kLinkCounts[] = {
    {"requests_sent", &LinkRecord::requests_sent},
    {"requests_received", &LinkRecord::requests_received},
    {"messages_sent", &LinkRecord::messages_sent},
    {"messages_received", &LinkRecord::messages_received},
    {"fused", &LinkRecord::fused},
    {"gated", &LinkRecord::gated},
    {"rejected", &LinkRecord::rejected},
    {"payload_bytes_sent", &LinkRecord::payload_bytes_sent},
};

constexpr char kStampColumn[] = "stamp_ns";
// In the order of ExchangeEvent.
constexpr const char* kEventNames[] = {"asked", "heard",    "answered", "fused",
                                       "gated", "rejected", "told",     "learned"};

ExchangeEvent event_from(const CsvReader& reader, std::string_view name) {
  for (std::size_t i = 0; i < std::size(kEventNames); ++i) {
    if (name == kEventNames[i]) return static_cast<ExchangeEvent>(i);
  }
  reader.fail("unknown event '" + std::string(name) + "'");
}

// What a file of each kind of record is called, and how it begins; what a record's line is.
template <typename Record>
struct Tag {};

std::string file_of(Tag<TimingRecord>) { return kTimingsFile; }
std::string header_of(Tag<TimingRecord>) {
  std::string header = kStampColumn;
  for (const TimeColumn& column : kTimeColumns) header += std::string(",") + column.name;
  for (const auto& column : kTimingCounts) header += std::string(",") + column.name;
  return header;
}
std::string line_of(const TimingRecord& record) {
  std::string line = std::to_string(record.stamp_ns);
  char field[32];
  for (const TimeColumn& column : kTimeColumns) {
    std::snprintf(field, sizeof field, ",%.4f", record.*column.ms);
    line += field;
  }
  for (const auto& column : kTimingCounts) line += "," + std::to_string(record.*column.count);
  return line;
}

std::string file_of(Tag<LinkRecord>) { return kLinkFile; }
std::string header_of(Tag<LinkRecord>) {
  std::string header = kStampColumn;
  for (const auto& column : kLinkCounts) header += std::string(",") + column.name;
  return header;
}
std::string line_of(const LinkRecord& record) {
  std::string line = std::to_string(record.stamp_ns);
  for (const auto& column : kLinkCounts) line += "," + std::to_string(record.*column.count);
  return line;
}

std::string file_of(Tag<ExchangeRecord>) { return kExchangeFile; }
std::string header_of(Tag<ExchangeRecord>) { return "clock_ms,event,peer,keyframe_id"; }
std::string line_of(const ExchangeRecord& record) {
  char clock[32];
  std::snprintf(clock, sizeof clock, "%.3f", record.clock_ms);
  return std::string(clock) + "," + kEventNames[static_cast<std::size_t>(record.event)] + "," +
         record.peer + "," + std::to_string(record.keyframe_id);
}

std::string file_of(Tag<PhotometricRecord>) { return kThermalFile; }
std::string header_of(Tag<PhotometricRecord>) { return "stamp_ns,chain_ns,gain,offset"; }
std::string line_of(const PhotometricRecord& record) {
  char line[96];
  std::snprintf(line, sizeof line, "%lld,%lld,%.6g,%.6g", static_cast<long long>(record.stamp_ns),
                static_cast<long long>(record.chain_ns), record.map.gain, record.map.offset);
  return line;
}

// Where each named column is; found once, in the header line.
class Header {
 public:
  explicit Header(CsvReader& reader) : reader_(reader) {
    if (!reader.next()) reader.fail("the header line with the names of the columns is missing");
    for (std::size_t i = 0; i < reader.columns(); ++i) names_.emplace_back(reader.text(i));
  }

  [[nodiscard]] std::size_t column(std::string_view name) const {
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (names_[i] == name) return i;
    }
    reader_.fail("column '" + std::string(name) + "' is missing");
  }

  // The next line, with a field for each name.
  [[nodiscard]] bool next() {
    if (!reader_.next()) return false;
    reader_.require_columns(names_.size(), "as the header line says");
    return true;
  }

 private:
  CsvReader& reader_;
  std::vector<std::string> names_;
};

template <typename Record, std::size_t N>
std::vector<std::size_t> columns_of(const Header& header, const CountColumn<Record> (&counts)[N]) {
  std::vector<std::size_t> columns;
  for (const auto& count : counts) columns.push_back(header.column(count.name));
  return columns;
}

LostLines lost_in(const LineWriter& file, const std::string& name) {
  if (file.lost_lines() == 0) return {};
  return {{name, file.lost_lines()}};
}

}  // namespace

OdometryWriter::OdometryWriter(const std::filesystem::path& folder)
    : trajectory_(folder / kTrajectoryFile, kTumHeader),
      covariance_(folder / kCovarianceFile, kCovarianceHeader) {}

void OdometryWriter::write(const Odometry& odometry) {
  trajectory_.write_line(tum_line({odometry.stamp_ns, odometry.pose}));
  covariance_.write_line(covariance_line({odometry.stamp_ns, odometry.pose_covariance}));
}

LostLines OdometryWriter::lost_lines() const {
  LostLines lost = lost_in(trajectory_, kTrajectoryFile);
  lost.merge(lost_in(covariance_, kCovarianceFile));
  return lost;
}

template <typename Record>
RunFileWriter<Record>::RunFileWriter(const std::filesystem::path& folder)
    : file_(folder / file_of(Tag<Record>()), header_of(Tag<Record>())) {}

template <typename Record>
void RunFileWriter<Record>::write(const Record& record) {
  file_.write_line(line_of(record));
}

template <typename Record>
LostLines RunFileWriter<Record>::lost_lines() const {
  return lost_in(file_, file_of(Tag<Record>()));
}

template class RunFileWriter<TimingRecord>;
template class RunFileWriter<LinkRecord>;
template class RunFileWriter<ExchangeRecord>;
template class RunFileWriter<PhotometricRecord>;

void write_field(const std::filesystem::path& folder, const cv::Mat& field) {
  constexpr int kColumns = 40;
  cv::Mat coarse;
  cv::resize(field, coarse, {kColumns, kColumns * field.rows / field.cols}, 0, 0, cv::INTER_AREA);
  std::string lines;
  char cell[32];
  for (int y = 0; y < coarse.rows; ++y) {
    for (int x = 0; x < coarse.cols; ++x) {
      std::snprintf(cell, sizeof cell, "%s%.3g", x > 0 ? "," : "", coarse.at<float>(y, x));
      lines += cell;
    }
    lines += '\n';
  }
  write_whole_file(folder / kFieldFile, lines);
}

void write_corners(const std::filesystem::path& folder, const std::vector<CornerRecord>& corners) {
  std::string lines = "log10_response,raw,calibrated\n";
  char line[96];
  for (const CornerRecord& corner : corners) {
    std::snprintf(line, sizeof line, "%.2f,%.6g,%.6g\n", corner.log10_response, corner.raw,
                  corner.calibrated);
    lines += line;
  }
  write_whole_file(folder / kCornersFile, lines);
}

std::vector<TimingRecord> read_timings(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  Header header(reader);
  const std::size_t stamp = header.column(kStampColumn);
  std::vector<std::size_t> times;
  for (const TimeColumn& column : kTimeColumns) times.push_back(header.column(column.name));
  const std::vector<std::size_t> counts = columns_of(header, kTimingCounts);
  std::vector<TimingRecord> records;
  while (header.next()) {
    TimingRecord& record = records.emplace_back();
    record.stamp_ns = reader.stamp_from_nanoseconds(stamp);
    for (std::size_t i = 0; i < times.size(); ++i) {
      record.*kTimeColumns[i].ms = reader.number(times[i]);
    }
    for (std::size_t i = 0; i < counts.size(); ++i) {
      record.*kTimingCounts[i].count = reader.integer(counts[i]);
    }
  }
  return records;
}

std::vector<LinkRecord> read_link(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  Header header(reader);
  const std::size_t stamp = header.column(kStampColumn);
  const std::vector<std::size_t> counts = columns_of(header, kLinkCounts);
  std::vector<LinkRecord> records;
  while (header.next()) {
    LinkRecord& record = records.emplace_back();
    record.stamp_ns = reader.stamp_from_nanoseconds(stamp);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      record.*kLinkCounts[i].count = reader.integer(counts[i]);
    }
  }
  return records;
}

std::vector<ExchangeRecord> read_exchange(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  Header header(reader);
  const std::size_t clock = header.column("clock_ms"), event = header.column("event"),
                    peer = header.column("peer"), keyframe = header.column("keyframe_id");
  std::vector<ExchangeRecord> records;
  while (header.next()) {
    ExchangeRecord& record = records.emplace_back();
    record.clock_ms = reader.number(clock);
    record.event = event_from(reader, reader.text(event));
    record.peer = reader.text(peer);
    record.keyframe_id = static_cast<std::uint64_t>(reader.integer(keyframe));
  }
  return records;
}

std::vector<PhotometricRecord> read_thermal(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  Header header(reader);
  const std::size_t stamp = header.column(kStampColumn), chain = header.column("chain_ns"),
                    gain = header.column("gain"), offset = header.column("offset");
  std::vector<PhotometricRecord> records;
  while (header.next()) {
    records.push_back({reader.stamp_from_nanoseconds(stamp),
                       reader.stamp_from_nanoseconds(chain),
                       {reader.number(gain), reader.number(offset)}});
  }
  return records;
}

std::vector<CornerRecord> read_corners(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  Header header(reader);
  const std::size_t response = header.column("log10_response"), raw = header.column("raw"),
                    calibrated = header.column("calibrated");
  std::vector<CornerRecord> records;
  while (header.next()) {
    records.push_back({reader.number(response), reader.number(raw), reader.number(calibrated)});
  }
  return records;
}

cv::Mat read_field(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  cv::Mat field;
  while (reader.next()) {
    cv::Mat row(1, static_cast<int>(reader.columns()), CV_32FC1);
    if (!field.empty() && row.cols != field.cols) reader.fail("not as wide as the first row");
    for (int x = 0; x < row.cols; ++x)
      row.at<float>(0, x) = static_cast<float>(reader.number(static_cast<std::size_t>(x)));
    field.push_back(row);
  }
  return field;
}

}  // namespace covey
