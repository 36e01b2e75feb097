// SPDX-License-Identifier: Apache-2.0
#include "apps/trajectory_file.h"

#include <cinttypes>
#include <cstdio>
#include <stdexcept>

#include "apps/csv.h"

namespace covey {
namespace {

constexpr std::size_t kPoseColumns = 8;
constexpr std::size_t kCovarianceColumns = 1 + 21;

CsvReader::Separator separator_of(const std::filesystem::path& file) {
  const CsvReader reader(file, CsvReader::Separator::kComma);
  const bool has_comma = reader.peek().find(',') != std::string_view::npos;
  return has_comma ? CsvReader::Separator::kComma : CsvReader::Separator::kSpace;
}

StampedPose read_euroc_pose(const CsvReader& reader) {
  reader.require_columns(kPoseColumns, "EuRoC csv: stamp [ns], x, y, z, qw, qx, qy, qz");
  return {reader.stamp_from_nanoseconds(0), {reader.vector3(1), reader.quaternion(4, 5, 6, 7)}};
}

StampedPose read_tum_pose(const CsvReader& reader) {
  reader.require_columns(kPoseColumns, "TUM: t [s] x y z qx qy qz qw");
  return {reader.stamp_from_seconds(0), {reader.vector3(1), reader.quaternion(7, 4, 5, 6)}};
}

}  // namespace

StampedPoses read_trajectory(const std::filesystem::path& file) {
  const CsvReader::Separator separator = separator_of(file);
  CsvReader reader(file, separator);
  StampedPoses trajectory;
  while (reader.next()) {
    const StampedPose pose =
        separator == CsvReader::Separator::kComma ? read_euroc_pose(reader) : read_tum_pose(reader);
    if (!trajectory.empty()) {
      require_increasing(reader, trajectory.back().stamp_ns, pose.stamp_ns);
    }
    trajectory.push_back(pose);
  }
  if (trajectory.empty()) {
    throw std::runtime_error(file.string() + ": holds no pose");
  }
  return trajectory;
}

std::vector<StampedCovariance> read_covariances(const std::filesystem::path& file) {
  CsvReader reader(file, CsvReader::Separator::kComma);
  std::vector<StampedCovariance> covariances;
  while (reader.next()) {
    reader.require_columns(kCovarianceColumns,
                           "stamp [ns] and the 21 upper entries of a 6x6 covariance");
    StampedCovariance sample;
    sample.stamp_ns = reader.stamp_from_nanoseconds(0);
    if (!covariances.empty()) {
      require_increasing(reader, covariances.back().stamp_ns, sample.stamp_ns);
    }
    std::size_t column = 1;
    for (int row = 0; row < 6; ++row) {
      for (int col = row; col < 6; ++col) {
        sample.covariance(row, col) = sample.covariance(col, row) = reader.number(column++);
      }
    }
    covariances.push_back(sample);
  }
  return covariances;
}

std::string tum_line(const StampedPose& pose) {
  const Eigen::Vector3d& p = pose.pose.p_world_imu;
  const Eigen::Quaterniond& q = pose.pose.q_world_imu;
  char line[256];
  std::snprintf(line, sizeof line, "%" PRId64 ".%09" PRId64 " %.9f %.9f %.9f %.9f %.9f %.9f %.9f",
                pose.stamp_ns / 1000000000, pose.stamp_ns % 1000000000, p.x(), p.y(), p.z(), q.x(),
                q.y(), q.z(), q.w());
  return line;
}

std::string covariance_line(const StampedCovariance& sample) {
  std::string line = std::to_string(sample.stamp_ns);
  char entry[32];
  for (int row = 0; row < 6; ++row) {
    for (int col = row; col < 6; ++col) {
      std::snprintf(entry, sizeof entry, ",%.9g", sample.covariance(row, col));
      line += entry;
    }
  }
  return line;
}

void write_tum(const std::filesystem::path& file, const StampedPoses& trajectory) {
  LineWriter writer(file, kTumHeader);
  for (const StampedPose& pose : trajectory) writer.write_line(tum_line(pose));
  writer.require_whole();
}

}  // namespace covey
