// SPDX-License-Identifier: Apache-2.0
#include "apps/dataset.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <utility>

#include "apps/csv.h"
#include "apps/png_file.h"
#include "apps/sensor_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

constexpr double kGapFactor = 5;  // an IMU gap: this many times the median period

bool is_mav0(const fs::path& folder) {
  return fs::is_directory(folder / "cam0") && fs::is_directory(folder / "imu0");
}

// uav2 before uav10: digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    while (i < a.size() && a[i] == '0') ++i;
    while (j < b.size() && b[j] == '0') ++j;
    const std::size_t a_begin = i;
    const std::size_t b_begin = j;
    while (i < a.size() && is_digit(a[i])) ++i;
    while (j < b.size() && is_digit(b[j])) ++j;
    if (i - a_begin != j - b_begin) return i - a_begin < j - b_begin;
    const int order = a.compare(a_begin, i - a_begin, b, b_begin, j - b_begin);
    if (order != 0) return order < 0;
  }
  return a.size() - i < b.size() - j || (a.size() - i == b.size() - j && a < b);
}

std::vector<ImageEntry> read_image_list(const fs::path& cam0) {
  const fs::path csv = cam0 / "data.csv";
  CsvReader reader(csv, CsvReader::Separator::kComma);
  std::vector<ImageEntry> images;
  while (reader.next()) {
    reader.require_columns(2, "stamp [ns], file name");
    ImageEntry image;
    image.stamp_ns = reader.stamp_from_nanoseconds(0);
    image.path = cam0 / "data" / std::string(reader.text(1));
    if (!images.empty()) require_increasing(reader, images.back().stamp_ns, image.stamp_ns);
    images.push_back(std::move(image));
  }
  if (images.empty()) throw std::runtime_error(csv.string() + ": lists no image");
  return images;
}

// In flight they are left out as others are that cannot be read.
std::vector<std::string> missing_images_warning(const fs::path& csv,
                                                const std::vector<ImageEntry>& images) {
  const auto is_missing = [](const ImageEntry& image) { return !fs::is_regular_file(image.path); };
  const auto first = std::find_if(images.begin(), images.end(), is_missing);
  if (first == images.end()) return {};
  return {csv.string() + ": " + std::to_string(std::count_if(first, images.end(), is_missing)) +
          " of " + std::to_string(images.size()) + " images are not there, the first of them " +
          first->path.string()};
}

std::vector<ImuGap> find_gaps(const std::vector<ImuSample>& imu) {
  std::vector<TimeNs> periods;
  for (std::size_t i = 1; i < imu.size(); ++i) {
    periods.push_back(imu[i].stamp_ns - imu[i - 1].stamp_ns);
  }
  std::vector<TimeNs> sorted = periods;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double longest = kGapFactor * static_cast<double>(*middle);
  std::vector<ImuGap> gaps;
  for (std::size_t i = 0; i < periods.size(); ++i) {
    if (static_cast<double>(periods[i]) > longest) {
      gaps.push_back({imu[i].stamp_ns, imu[i + 1].stamp_ns});
    }
  }
  return gaps;
}

std::string gap_warning(const fs::path& file, const ImuGap& gap) {
  char text[96];
  std::snprintf(text, sizeof text, ": no IMU for %.1f ms after stamp %lld ns",
                seconds_between(gap.from_ns, gap.to_ns) * 1e3, static_cast<long long>(gap.from_ns));
  return file.string() + text;
}

// What of the images the IMU does not reach, and so is not flown.
std::vector<std::string> coverage_warnings(const fs::path& imu_csv, const Dataset& dataset) {
  constexpr double kWorthSaying_s = 0.1;
  std::vector<std::string> warnings;
  const auto warn = [&](double missing_s, const char* where) {
    if (missing_s <= kWorthSaying_s) return;
    char text[96];
    std::snprintf(text, sizeof text, ": %s by %.1f s: what lies beyond is not flown", where,
                  missing_s);
    warnings.push_back(imu_csv.string() + text);
  };
  warn(seconds_between(dataset.images.front().stamp_ns, dataset.imu.front().stamp_ns),
       "begins after the images");
  warn(seconds_between(dataset.imu.back().stamp_ns, dataset.images.back().stamp_ns),
       "ends before the images");
  return warnings;
}

struct Span {
  fs::path file;
  TimeNs first_ns = 0;
  TimeNs last_ns = 0;
};

void require_overlap(const Span& images, const Span& other, const std::string& what) {
  if (other.first_ns < images.last_ns && other.last_ns > images.first_ns) return;
  throw std::runtime_error(other.file.string() + ": " + what + " from " +
                           std::to_string(other.first_ns) + " to " + std::to_string(other.last_ns) +
                           " ns does not overlap the images from " +
                           std::to_string(images.first_ns) + " to " +
                           std::to_string(images.last_ns) + " ns: are both on one clock?");
}

// Central differences, one-sided at the ends and where holes begin and end: for files that hold
// poses only.
void differentiate_velocity(std::vector<TrueState>& states) {
  const auto is_hole = [&](std::size_t i) {  // between i and the next
    return seconds_between(states[i].stamp_ns, states[i + 1].stamp_ns) > kLongestTruthGap_s;
  };
  const std::size_t last = states.size() - 1;
  for (std::size_t i = 0; i < states.size(); ++i) {
    std::size_t before = i == 0 ? 0 : i - 1, after = std::min(i + 1, last);
    if (before < i && after > i && is_hole(before) != is_hole(i)) {
      is_hole(before) ? before = i : after = i;
    }
    states[i].v_world_imu = (states[after].pose.p_world_imu - states[before].pose.p_world_imu) /
                            seconds_between(states[before].stamp_ns, states[after].stamp_ns);
  }
}

TrueState read_state(const CsvReader& reader) {
  reader.require_columns(8, "stamp [ns], x, y, z, qw, qx, qy, qz[, velocity[, biases]]");
  TrueState state;
  state.stamp_ns = reader.stamp_from_nanoseconds(0);
  state.pose = {reader.vector3(1), reader.quaternion(4, 5, 6, 7)};
  if (reader.columns() >= 11) state.v_world_imu = reader.vector3(8);
  if (reader.columns() >= 17) {
    state.gyro_bias = reader.vector3(11);
    state.accel_bias = reader.vector3(14);
  }
  return state;
}

// Ground truth, which has 8, 11 or 17 columns, would be flown as angular rates. A comma at the end
// of the line is no column.
void require_imu_columns(const CsvReader& reader) {
  const std::string names = "stamp [ns], angular rate x y z, specific force x y z";
  reader.require_columns(7, names);
  const bool has_eight = reader.columns() == 8 && !reader.text(7).empty();
  if (has_eight || reader.columns() >= 11)
    reader.fail("the line has " + std::to_string(reader.columns()) +
                " columns, as ground truth has; an IMU's has 7: " + names);
}

Eigen::Vector3d mix(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double t) {
  return a + t * (b - a);
}

std::vector<TrueState>::const_iterator first_not_before(const GroundTruth& truth, TimeNs stamp_ns) {
  return std::lower_bound(
      truth.states.begin(), truth.states.end(), stamp_ns,
      [](const TrueState& state, TimeNs stamp) { return state.stamp_ns < stamp; });
}

// Empty where there is no such file.
cv::Mat read_mask(const fs::path& file, const CameraIntrinsics& camera) {
  if (!fs::exists(file)) return {};
  cv::Mat mask = read_image({0, file}, camera.width, camera.height);
  if (mask.depth() != CV_8U)
    throw std::runtime_error(file.string() + ": a mask has 8 bits, black where no scene is seen");
  mask = mask > 127;  // what was drawn by hand has soft edges
  if (cv::countNonZero(mask) == 0)
    throw std::runtime_error(file.string() +
                             ": all of it is black, which says that no scene is seen anywhere");
  return mask;
}

fs::path without_detours(const fs::path& folder) {
  return fs::absolute(folder / "").lexically_normal().parent_path();
}

// All of them if it has fewer.
fs::path last_parts(const fs::path& path, std::ptrdiff_t count) {
  const std::ptrdiff_t left_out = std::distance(path.begin(), path.end()) - count;
  fs::path last;
  for (auto part = std::next(path.begin(), std::max<std::ptrdiff_t>(left_out, 0));
       part != path.end(); ++part)
    last /= *part;
  return last;
}

}  // namespace

std::vector<DroneFolder> find_drones(const fs::path& folder) {
  if (!fs::is_directory(folder)) {
    throw std::runtime_error(folder.string() + ": is not a folder: is the path right?");
  }
  if (is_mav0(folder)) return {{"uav0", folder}};
  if (is_mav0(folder / "mav0")) return {{"uav0", folder / "mav0"}};
  std::vector<DroneFolder> drones;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (fs::is_directory(entry.path() / "mav0")) {
      drones.push_back({entry.path().filename().string(), entry.path() / "mav0"});
    }
  }
  if (drones.empty()) {
    throw std::runtime_error(folder.string() +
                             ": holds no drone: expected uavK/mav0/cam0 and uavK/mav0/imu0 in it");
  }
  std::sort(drones.begin(), drones.end(), [](const DroneFolder& a, const DroneFolder& b) {
    return natural_less(a.name, b.name);
  });
  return drones;
}

std::string dataset_name(const fs::path& folder) { return without_detours(folder).filename(); }

std::vector<std::string> dataset_names(const std::vector<fs::path>& folders) {
  std::vector<fs::path> paths;
  for (const fs::path& folder : folders) {
    paths.push_back(without_detours(folder));
    if (std::count(paths.begin(), paths.end(), paths.back()) > 1)
      throw std::runtime_error(folder.string() + ": is named twice");
  }
  std::vector<std::string> names;
  for (const fs::path& path : paths) {
    std::ptrdiff_t parts = 1;
    while (std::count_if(paths.begin(), paths.end(), [&](const fs::path& other) {
             return last_parts(other, parts) == last_parts(path, parts);
           }) > 1)
      ++parts;
    names.push_back(last_parts(path, parts));
  }
  return names;
}

std::vector<ImuSample> read_imu(const fs::path& csv) {
  CsvReader reader(csv, CsvReader::Separator::kComma);
  std::vector<ImuSample> samples;
  while (reader.next()) {
    require_imu_columns(reader);
    ImuSample sample;
    sample.stamp_ns = reader.stamp_from_nanoseconds(0);
    sample.gyro_imu = reader.vector3(1);
    sample.accel_imu = reader.vector3(4);
    if (!samples.empty()) require_increasing(reader, samples.back().stamp_ns, sample.stamp_ns);
    samples.push_back(sample);
  }
  if (samples.size() < 2) throw std::runtime_error(csv.string() + ": holds no IMU samples");
  return samples;
}

GroundTruth read_ground_truth(const fs::path& csv) {
  CsvReader reader(csv, CsvReader::Separator::kComma);
  GroundTruth truth;
  std::size_t columns = 0;
  while (reader.next()) {
    if (truth.states.empty()) columns = reader.columns();
    reader.require_columns(columns, "as in the lines before");
    const TrueState state = read_state(reader);
    if (!truth.states.empty()) {
      require_increasing(reader, truth.states.back().stamp_ns, state.stamp_ns);
    }
    truth.states.push_back(state);
  }
  if (truth.states.size() < 2) {
    throw std::runtime_error(csv.string() +
                             ": holds no ground truth; remove the folder if there is none");
  }
  if (columns < 11) differentiate_velocity(truth.states);
  return truth;
}

fs::path ground_truth_file(const fs::path& mav0) {
  return mav0 / "state_groundtruth_estimate0" / "data.csv";
}

Dataset read_sensors(const fs::path& mav0) {
  Dataset dataset;
  const fs::path camera_yaml = mav0 / "cam0" / "sensor.yaml";
  const CameraCalibration camera = read_camera_file(camera_yaml);
  dataset.camera = camera.intrinsics;
  dataset.extrinsics = camera.extrinsics;
  dataset.thermal = camera.thermal;
  dataset.line_delay_s = camera.line_delay_s;
  dataset.mask = read_mask(mav0 / "cam0" / "mask.png", camera.intrinsics);
  const fs::path imu_yaml = mav0 / "imu0" / "sensor.yaml";
  dataset.imu_noise = read_imu_file(imu_yaml);
  dataset.warnings = doubts_about(camera, camera_yaml);
  for (std::string& doubt : doubts_about(dataset.imu_noise, imu_yaml))
    dataset.warnings.push_back(std::move(doubt));
  return dataset;
}

Dataset read_dataset(const fs::path& mav0) {
  Dataset dataset = read_sensors(mav0);
  dataset.images = read_image_list(mav0 / "cam0");
  const fs::path image_csv = mav0 / "cam0" / "data.csv";
  for (std::string& warning : missing_images_warning(image_csv, dataset.images))
    dataset.warnings.push_back(std::move(warning));
  const Span images{image_csv, dataset.images.front().stamp_ns, dataset.images.back().stamp_ns};

  const fs::path imu_csv = mav0 / "imu0" / "data.csv";
  dataset.imu = read_imu(imu_csv);
  require_overlap(images, {imu_csv, dataset.imu.front().stamp_ns, dataset.imu.back().stamp_ns},
                  "the IMU");
  for (std::string& warning : coverage_warnings(imu_csv, dataset))
    dataset.warnings.push_back(std::move(warning));
  dataset.imu_gaps = find_gaps(dataset.imu);
  for (const ImuGap& gap : dataset.imu_gaps) dataset.warnings.push_back(gap_warning(imu_csv, gap));

  const fs::path truth_csv = ground_truth_file(mav0);
  if (fs::exists(truth_csv.parent_path())) {
    dataset.ground_truth = read_ground_truth(truth_csv);
    const std::vector<TrueState>& states = dataset.ground_truth->states;
    require_overlap(images, {truth_csv, states.front().stamp_ns, states.back().stamp_ns},
                    "the ground truth");
  }
  return dataset;
}

std::optional<TrueState> ground_truth_at(const GroundTruth& truth, TimeNs stamp_ns) {
  const auto after = first_not_before(truth, stamp_ns);
  if (after == truth.states.end()) return std::nullopt;
  if (after->stamp_ns == stamp_ns) return *after;
  if (after == truth.states.begin()) return std::nullopt;
  const TrueState& a = *(after - 1);
  const TrueState& b = *after;
  const double gap_s = seconds_between(a.stamp_ns, b.stamp_ns);
  if (gap_s > kLongestTruthGap_s) return std::nullopt;
  const double t = seconds_between(a.stamp_ns, stamp_ns) / gap_s;
  TrueState state;
  state.stamp_ns = stamp_ns;
  state.pose.p_world_imu = mix(a.pose.p_world_imu, b.pose.p_world_imu, t);
  state.pose.q_world_imu = a.pose.q_world_imu.slerp(t, b.pose.q_world_imu);
  state.v_world_imu = mix(a.v_world_imu, b.v_world_imu, t);
  state.gyro_bias = mix(a.gyro_bias, b.gyro_bias, t);
  state.accel_bias = mix(a.accel_bias, b.accel_bias, t);
  return state;
}

const TrueState& nearest_state(const GroundTruth& truth, TimeNs stamp_ns) {
  const auto after = first_not_before(truth, stamp_ns);
  if (after == truth.states.begin()) return *after;
  const TrueState& before = *(after - 1);
  if (after == truth.states.end()) return before;
  return stamp_ns - before.stamp_ns < after->stamp_ns - stamp_ns ? before : *after;
}

StampedPoses to_trajectory(const GroundTruth& truth) {
  StampedPoses trajectory;
  for (const TrueState& state : truth.states) {
    trajectory.push_back({state.stamp_ns, state.pose});
  }
  return trajectory;
}

cv::Mat read_image(const ImageEntry& image, int width, int height) {
  cv::Mat pixels = read_png(image.path.string());
  if (pixels.cols != width || pixels.rows != height) {
    throw std::runtime_error(image.path.string() + ": the image is " + std::to_string(pixels.cols) +
                             "x" + std::to_string(pixels.rows) + ", sensor.yaml says " +
                             std::to_string(width) + "x" + std::to_string(height));
  }
  return pixels;
}

cv::Mat first_readable(const Dataset& dataset) {
  const std::vector<ImageEntry>& images = dataset.images;
  for (std::size_t i = 0;; ++i) {
    try {
      return read_image(images[i], dataset.camera.width, dataset.camera.height);
    } catch (const std::runtime_error& error) {
      if (i + 1 < images.size()) continue;
      throw std::runtime_error(std::string("no image can be read: ") + error.what());
    }
  }
}

Dataset read_recording(const std::filesystem::path& mav0) {
  Dataset dataset = read_dataset(mav0);
  if (dataset.images.empty()) throw std::runtime_error(mav0.string() + ": no images");
  const cv::Mat first = first_readable(dataset);
  dataset.thermal = dataset.thermal || first.depth() == CV_16U;
  return dataset;
}

}  // namespace covey
