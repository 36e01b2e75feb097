// SPDX-License-Identifier: Apache-2.0
//
// Recorded motion for tests, from the shared data folder.
#pragma once

#include <algorithm>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct RecordedMotion {
  std::vector<double> times_s;
  std::vector<Pose> poses;
};

// Ground truth in EuRoC csv; nothing where the file is absent.
inline std::optional<RecordedMotion> read_recorded(const std::string& file) {
  std::ifstream in(std::string(COVEY_SHARED_DATA_DIR) + "/" + file);
  if (!in) return std::nullopt;
  RecordedMotion motion;
  std::optional<TimeNs> first;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream values(line);
    TimeNs stamp = 0;
    Pose pose;
    Eigen::Vector3d& p = pose.p_world_imu;
    Eigen::Quaterniond& q = pose.q_world_imu;
    values >> stamp >> p.x() >> p.y() >> p.z() >> q.w() >> q.x() >> q.y() >> q.z();
    first = first.value_or(stamp);
    motion.times_s.push_back(seconds_between(*first, stamp));
    motion.poses.push_back(pose);
  }
  return motion;
}

}  // namespace covey
