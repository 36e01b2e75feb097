// SPDX-License-Identifier: Apache-2.0
#include "sim/dataset_writer.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <iomanip>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace covey {
namespace {

namespace fs = std::filesystem;

std::ofstream create(const fs::path& file) {
  std::error_code error;
  fs::create_directories(file.parent_path(), error);
  std::ofstream stream(file);
  if (!stream) throw std::runtime_error(file.string() + ": cannot be created");
  return stream;
}

void finish(std::ofstream& stream, const fs::path& file) {
  stream.close();
  if (!stream) throw std::runtime_error(file.string() + ": cannot be written: is the disk full?");
}

void write_transform(std::ostream& out, const Eigen::Isometry3d& T_body_sensor) {
  out << "T_BS:\n  cols: 4\n  rows: 4\n  data: [";
  const Eigen::Matrix4d& m = T_body_sensor.matrix();
  for (int row = 0; row < 4; ++row) {
    if (row > 0) out << ",\n         ";
    for (int col = 0; col < 4; ++col) out << (col > 0 ? ", " : "") << m(row, col);
  }
  out << "]\n\n";
}

// Absolute, with no . or .. in it and nothing at its end.
fs::path where_links_lead(const fs::path& name) {
  std::error_code error;
  const fs::path target = fs::weakly_canonical(name, error);
  if (error) throw std::runtime_error(name.string() + ": cannot be made: " + error.message());
  return target.has_filename() ? target : target.parent_path();
}

// Throws where something is that may not go. `name`: of the target, as it was given.
void require_replaceable(const fs::path& target, const fs::path& name, IsReplaceable is_replaceable,
                         const std::string& way_out) {
  std::error_code ignored;
  const fs::file_status status = fs::symlink_status(target, ignored);
  if (fs::is_symlink(status)) throw std::runtime_error(name.string() + ": is a link to nothing");
  if (!fs::exists(status)) return;
  if (fs::equivalent(target, fs::current_path(ignored), ignored))
    throw std::runtime_error(name.string() + ": cannot be replaced from inside it");
  const bool is_folder = fs::is_directory(status);
  if (is_folder && fs::is_empty(target)) return;
  if (is_replaceable == nullptr)
    throw std::runtime_error(name.string() + ": exists already; " + way_out);
  if (is_folder && is_replaceable(target)) return;
  throw std::runtime_error(name.string() +
                           ": --force replaces only what this command has written, and there is "
                           "something else; choose another --out");
}

// False as well if it is no folder, or is empty.
template <typename Test>
bool all_in(const fs::path& folder, Test is_good) {
  if (!fs::is_directory(fs::symlink_status(folder)) || fs::is_empty(folder)) return false;
  const fs::directory_iterator entries(folder);
  return std::all_of(begin(entries), end(entries),
                     [&](const auto& entry) { return is_good(entry.path()); });
}

bool is_png(const fs::path& file) {
  return file.extension() == ".png" && fs::is_regular_file(fs::symlink_status(file));
}

bool is_written_for_sensor(const fs::path& entry) {
  const fs::path name = entry.filename();
  if (name == "data") return all_in(entry, is_png);
  return name == "sensor.yaml" || name == "data.csv";
}

// Every version has written so.
bool is_of_simulated_camera(const fs::path& sensor_yaml) {
  std::ifstream file(sensor_yaml);
  for (std::string line; std::getline(file, line);)
    if (line.rfind("comment: simulated ", 0) == 0) return true;
  return false;
}

// With the truth, which is not there where a recording was imported with a simulated calibration.
bool is_simulated_drone(const fs::path& mav0) {
  constexpr const char* kTruth = "state_groundtruth_estimate0";
  const std::array<fs::path, 5> sensors = {"cam0", "cam0raw16", "imu0", kTruth, "thermal_truth0"};
  return is_of_simulated_camera(mav0 / "cam0" / "sensor.yaml") &&
         fs::exists(mav0 / kTruth / "data.csv") && all_in(mav0, [&](const fs::path& sensor) {
           const bool known =
               std::find(sensors.begin(), sensors.end(), sensor.filename()) != sensors.end();
           return known && all_in(sensor, is_written_for_sensor);
         });
}

void write_vector(std::ostream& out, const Eigen::Vector3d& v) {
  out << ',' << v.x() << ',' << v.y() << ',' << v.z();
}

}  // namespace

bool is_simulated(const fs::path& folder) {
  return all_in(fs::canonical(folder), [](const fs::path& drone) {
    return all_in(drone, [](const fs::path& mav0) {
      return mav0.filename() == "mav0" && is_simulated_drone(mav0);
    });
  });
}

StagedFolder::StagedFolder(fs::path target, IsReplaceable is_replaceable, std::string way_out)
    : name_(std::move(target)), is_replaceable_(is_replaceable), way_out_(std::move(way_out)) {
  if (name_.empty()) throw std::runtime_error("--out names no folder");
  target_ = where_links_lead(name_);
  require_replaceable(target_, name_, is_replaceable_, way_out_);
  staging_ = target_;
  staging_ += ".partial-" + std::to_string(::getpid());
  std::error_code error;
  fs::remove_all(staging_, error);
  fs::create_directories(staging_, error);
  if (error) throw std::runtime_error(name_.string() + ": cannot be made: " + error.message());
}

StagedFolder::~StagedFolder() {
  std::error_code ignored;
  if (!staging_.empty()) fs::remove_all(staging_, ignored);
}

void StagedFolder::commit() {
  require_replaceable(target_, name_, is_replaceable_, way_out_);  // it may have come meanwhile
  std::error_code error;
  if (is_replaceable_ != nullptr) fs::remove_all(target_, error);
  if (!error) fs::rename(staging_, target_, error);
  if (error) throw std::runtime_error(name_.string() + ": cannot be written: " + error.message());
  staging_.clear();
}

void write_camera_file(const fs::path& file, const CameraDescription& camera) {
  std::ofstream out = create(file);
  out << std::setprecision(15);
  const CameraIntrinsics& c = camera.intrinsics;
  Eigen::Isometry3d T_imu_cam = Eigen::Isometry3d::Identity();
  T_imu_cam.linear() = camera.extrinsics.q_imu_cam.toRotationMatrix();
  T_imu_cam.translation() = camera.extrinsics.p_imu_cam;
  const bool radial = c.model == DistortionModel::kRadialTangential;
  out << "# General sensor definitions.\nsensor_type: camera\ncomment: " << camera.comment
      << "\n\n# Sensor extrinsics wrt. the body-frame.\n";
  write_transform(out, T_imu_cam);
  out << "# Camera specific definitions.\nrate_hz: " << camera.rate_hz << "\nresolution: ["
      << c.width << ", " << c.height << "]\ncamera_model: pinhole\nintrinsics: [" << c.fx << ", "
      << c.fy << ", " << c.cx << ", " << c.cy
      << "] #fu, fv, cu, cv\ndistortion_model: " << (radial ? "radial-tangential" : "equidistant")
      << "\ndistortion_coefficients: [" << c.distortion[0] << ", " << c.distortion[1] << ", "
      << c.distortion[2] << ", " << c.distortion[3] << "]\n";
  if (camera.line_delay_s != 0)
    out << "line_delay: " << camera.line_delay_s << " # s, rolling shutter; stamps: middle row\n";
  finish(out, file);
}

void write_imu_file(const fs::path& file, const ImuNoise& noise, double rate_hz,
                    const std::string& comment) {
  std::ofstream out = create(file);
  out << std::setprecision(15)
      << "# IMU sensor definitions.\nsensor_type: imu\ncomment: " << comment
      << "\n\n# Sensor extrinsics wrt. the body-frame.\n";
  write_transform(out, Eigen::Isometry3d::Identity());
  out << "rate_hz: " << rate_hz << "\n\n# Inertial sensor noise model parameters (static).\n"
      << "gyroscope_noise_density: " << noise.gyro_density << "     # [ rad / s / sqrt(Hz) ]\n"
      << "gyroscope_random_walk: " << noise.gyro_random_walk
      << "       # [ rad / s^2 / sqrt(Hz) ]\n"
      << "accelerometer_noise_density: " << noise.accel_density << "  # [ m / s^2 / sqrt(Hz) ]\n"
      << "accelerometer_random_walk: " << noise.accel_random_walk
      << "    # [ m / s^3 / sqrt(Hz) ]\n";
  finish(out, file);
}

void write_imu_csv(const fs::path& file, const std::vector<ImuSample>& samples) {
  std::ofstream out = create(file);
  // Every digit of a double: a recorded IMU is passed on as it came.
  out << std::setprecision(17)
      << "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
         "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";
  for (const ImuSample& sample : samples) {
    out << sample.stamp_ns;
    write_vector(out, sample.gyro_imu);
    write_vector(out, sample.accel_imu);
    out << '\n';
  }
  finish(out, file);
}

void write_ground_truth_csv(const fs::path& file, const std::vector<TrueState>& states) {
  std::ofstream out = create(file);
  out << std::setprecision(12)
      << "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
         "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad "
         "s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m "
         "s^-2], b_a_RS_S_z [m s^-2]\n";
  for (const TrueState& state : states) {
    const Eigen::Quaterniond& q = state.pose.q_world_imu;
    out << state.stamp_ns;
    write_vector(out, state.pose.p_world_imu);
    out << ',' << q.w() << ',' << q.x() << ',' << q.y() << ',' << q.z();
    write_vector(out, state.v_world_imu);
    write_vector(out, state.gyro_bias);
    write_vector(out, state.accel_bias);
    out << '\n';
  }
  finish(out, file);
}

ImageList::ImageList(const fs::path& camera_folder)
    : folder_(camera_folder), csv_(create(camera_folder / "data.csv")) {
  std::error_code error;
  fs::create_directories(folder_ / "data", error);
  if (error) throw std::runtime_error((folder_ / "data").string() + ": " + error.message());
  csv_ << "#timestamp [ns],filename\n";
}

fs::path ImageList::add(TimeNs stamp_ns) {
  const std::string name = std::to_string(stamp_ns) + ".png";
  csv_ << stamp_ns << ',' << name << '\n';
  return folder_ / "data" / name;
}

void ImageList::close() { finish(csv_, folder_ / "data.csv"); }

}  // namespace covey
