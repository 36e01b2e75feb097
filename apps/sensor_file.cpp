// SPDX-License-Identifier: Apache-2.0
#include "apps/sensor_file.h"

#include <spdlog/fmt/fmt.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <optional>
#include <regex>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/whole_file.h"

namespace covey {
namespace {

constexpr double kRotationTolerance = 1e-3;  // of R^T R against the identity; files carry 6 digits
constexpr double kMaxResolution = 16384;     // pixels

// A yaml file and its path, so that every complaint can name both.
class SensorFile {
 public:
  explicit SensorFile(const std::filesystem::path& file) : file_(file) {
    load(read_whole_file(file));
  }

  [[nodiscard]] std::string text(const std::string& key) const { return as<std::string>(key); }

  [[nodiscard]] double positive(const std::string& key) const {
    const double value = as<double>(key);
    if (!std::isfinite(value) || value <= 0) fail(root_[key], key + " must be greater than zero");
    return value;
  }

  [[nodiscard]] double not_negative(const std::string& key) const {
    const double value = as<double>(key);
    if (!std::isfinite(value) || value < 0) fail(root_[key], key + " must not be negative");
    return value;
  }

  [[nodiscard]] bool has(const std::string& key) const { return bool(root_[key]); }

  [[nodiscard]] std::optional<double> optional_number(const std::string& key) const {
    if (!root_[key]) return std::nullopt;
    const double value = as<double>(key);
    if (!std::isfinite(value)) fail(root_[key], key + " must be finite");
    return value;
  }

  // Empty without the key.
  [[nodiscard]] std::string optional_text(const std::string& key) const {
    return root_[key] ? as<std::string>(key) : std::string();
  }

  [[nodiscard]] std::vector<double> numbers(const std::string& key, std::size_t count) const {
    return checked_numbers(node(key), key, count);
  }

  // x_body = T_BS * x_sensor
  [[nodiscard]] Eigen::Isometry3d sensor_to_body() const {
    YAML::Node matrix = node("T_BS");
    if (matrix.IsMap()) matrix = matrix["data"];
    if (!matrix) fail(node("T_BS"), "T_BS has no data");
    const std::vector<double> entries = checked_numbers(matrix, "T_BS", 16);
    const Eigen::Matrix4d T =
        Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(entries.data());
    const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
    const double skewness = (R.transpose() * R - Eigen::Matrix3d::Identity()).norm();
    if (skewness > kRotationTolerance || R.determinant() < 0 ||
        T.row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
      fail(matrix, "T_BS is not a rotation and a translation");
    }
    Eigen::Isometry3d T_body_sensor = Eigen::Isometry3d::Identity();
    T_body_sensor.linear() = Eigen::Quaterniond(R).normalized().toRotationMatrix();
    T_body_sensor.translation() = T.topRightCorner<3, 1>();
    return T_body_sensor;
  }

  [[noreturn]] void fail(const std::string& key, const std::string& what) const {
    fail(root_[key], what);
  }

 private:
  // yaml-cpp takes "%YAML 1.2" but not OpenCV's "%YAML:1.0": the line is blanked, lines keep
  // numbers.
  void load(std::string content) {
    if (content.rfind("%YAML", 0) == 0) {
      for (std::size_t i = 0; i < content.size() && content[i] != '\n'; ++i) content[i] = ' ';
    }
    try {
      root_ = YAML::Load(content);
    } catch (const YAML::Exception& error) {
      throw std::runtime_error(location(error.mark) + "not yaml: " + error.msg);
    }
    if (!root_.IsMap()) throw std::runtime_error(file_.string() + ": holds no 'key: value' lines");
    require_unique_keys(root_);
  }

  // Of two values of one key one would be lost without a word.
  void require_unique_keys(const YAML::Node& map) const {
    std::set<std::string> keys;
    for (const auto& entry : map) {
      const YAML::Node& key = entry.first;
      if (!key.IsScalar()) continue;
      if (!keys.insert(key.Scalar()).second) fail(key, "key '" + key.Scalar() + "' stands twice");
      if (entry.second.IsMap()) require_unique_keys(entry.second);
    }
  }

  [[nodiscard]] YAML::Node node(const std::string& key) const {
    const YAML::Node found = root_[key];
    if (!found) throw std::runtime_error(file_.string() + ": key '" + key + "' is missing");
    return found;
  }

  template <typename T>
  [[nodiscard]] T as(const std::string& key) const {
    const YAML::Node found = node(key);
    try {
      return found.as<T>();
    } catch (const YAML::Exception&) {
      fail(found, key + " has a value of the wrong kind");
    }
  }

  [[nodiscard]] std::vector<double> checked_numbers(const YAML::Node& list, const std::string& key,
                                                    std::size_t count) const {
    std::vector<double> values;
    try {
      values = list.as<std::vector<double>>();
    } catch (const YAML::Exception&) {
      fail(list, key + " is not a list of numbers");
    }
    if (values.size() != count) {
      fail(list, key + " has " + std::to_string(values.size()) + " numbers, expected " +
                     std::to_string(count));
    }
    for (const double value : values) {
      if (!std::isfinite(value)) fail(list, key + " holds a number that is not finite");
    }
    return values;
  }

  [[nodiscard]] std::string location(const YAML::Mark& mark) const {
    const std::string line = mark.is_null() ? "" : ":" + std::to_string(mark.line + 1);
    return file_.string() + line + ": ";
  }

  [[noreturn]] void fail(const YAML::Node& node, const std::string& what) const {
    throw std::runtime_error(location(node.Mark()) + what);
  }

  std::filesystem::path file_;
  YAML::Node root_;
};

// EuRoC files have no key for it: their comment names the camera. FLIR makes visual cameras as
// well.
bool names_thermal_camera(const std::string& comment) {
  constexpr auto kAnyCase = std::regex::ECMAScript | std::regex::icase;
  static const std::regex kOfOthers(
      R"(\b(not|no|non|without)[ -]?(an? )?(thermal|infrared)|athermal|thermally|)"
      R"((near|active|short-?wave)[ -]?infrared|infrared[ -]?(cut|block|filter|pass|illum|led|stereo))",
      kAnyCase);
  static const std::regex kThermal(
      "thermal|thermograph|infrared|[lm]wir|bolometer|boson|lepton|flir[ _-]?(tau|vue|a[0-9])",
      kAnyCase);
  return std::regex_search(std::regex_replace(comment, kOfOthers, ""), kThermal);
}

DistortionModel distortion_model(const SensorFile& file) {
  const std::string name = file.text("distortion_model");
  if (name == "radial-tangential" || name == "radtan") return DistortionModel::kRadialTangential;
  if (name == "equidistant") return DistortionModel::kEquidistant;
  file.fail("distortion_model", "unknown distortion_model '" + name +
                                    "'; known: radial-tangential, radtan, equidistant");
}

CameraIntrinsics intrinsics(const SensorFile& file) {
  if (const std::string name = file.text("camera_model"); name != "pinhole") {
    file.fail("camera_model", "unknown camera_model '" + name + "'; known: pinhole");
  }
  const std::vector<double> size = file.numbers("resolution", 2);
  const std::vector<double> f = file.numbers("intrinsics", 4);
  const std::vector<double> d = file.numbers("distortion_coefficients", 4);
  for (const double side : size) {
    if (side < 1 || side > kMaxResolution || side != std::floor(side)) {
      file.fail("resolution", "resolution must be two whole numbers of pixels");
    }
  }
  if (f[0] <= 0 || f[1] <= 0) {
    file.fail("intrinsics", "intrinsics [fu, fv, cu, cv]: the focal lengths must be positive");
  }
  CameraIntrinsics camera;
  camera.width = static_cast<int>(size[0]);
  camera.height = static_cast<int>(size[1]);
  camera.fx = f[0];
  camera.fy = f[1];
  camera.cx = f[2];
  camera.cy = f[3];
  camera.model = distortion_model(file);
  camera.distortion = {d[0], d[1], d[2], d[3]};
  return camera;
}

}  // namespace

CameraCalibration read_camera_file(const std::filesystem::path& yaml) {
  const SensorFile file(yaml);
  const Eigen::Isometry3d T_imu_cam = file.sensor_to_body();
  CameraCalibration calibration;
  calibration.intrinsics = intrinsics(file);
  calibration.extrinsics.q_imu_cam = Eigen::Quaterniond(T_imu_cam.linear());
  calibration.extrinsics.p_imu_cam = T_imu_cam.translation();
  // Kalibr's name: t_imu = t_camera + shift.
  calibration.extrinsics.time_offset_s = file.optional_number("timeshift_cam_imu").value_or(0.0);
  if (file.has("line_delay")) calibration.line_delay_s = file.not_negative("line_delay");
  calibration.thermal = names_thermal_camera(file.optional_text("comment"));
  return calibration;
}

ImuNoise read_imu_file(const std::filesystem::path& yaml) {
  const SensorFile file(yaml);
  if (!file.sensor_to_body().isApprox(Eigen::Isometry3d::Identity(), 1e-6)) {
    file.fail("T_BS",
              "T_BS of the IMU must be the identity: give cameras and ground truth in the frame of "
              "the IMU");
  }
  ImuNoise noise;
  noise.gyro_density = file.positive("gyroscope_noise_density");
  noise.gyro_random_walk = file.not_negative("gyroscope_random_walk");
  noise.accel_density = file.positive("accelerometer_noise_density");
  noise.accel_random_walk = file.not_negative("accelerometer_random_walk");
  return noise;
}

std::vector<std::string> doubts_about(const CameraCalibration& camera,
                                      const std::filesystem::path& file) {
  constexpr double kFarthest_m = 3;  // camera from IMU, of anything that flies on one
  constexpr double kNarrowest = 20, kWidest = 0.2;  // focal length over the image's width
  const CameraIntrinsics& lens = camera.intrinsics;
  std::vector<std::string> doubts;
  const auto doubt = [&](const std::string& what) {
    doubts.push_back(file.string() + ": " + what);
  };
  if (const double lever_m = camera.extrinsics.p_imu_cam.norm(); lever_m > kFarthest_m)
    doubt(fmt::format("T_BS: camera and IMU are {:.1f} m apart: is it in metres?", lever_m));
  const double focal = mean_focal_length_px(lens) / lens.width;
  if (focal > kNarrowest || focal < kWidest) {
    doubt(fmt::format(
        "intrinsics: a focal length of {:.4g} px for an image {} px wide: is it in pixels?",
        mean_focal_length_px(lens), lens.width));
  }
  if (!(lens.cx > 0 && lens.cx < lens.width && lens.cy > 0 && lens.cy < lens.height)) {
    doubt(fmt::format("intrinsics: the principal point ({:.4g}, {:.4g}) lies outside the image",
                      lens.cx, lens.cy));
  }
  constexpr double kSlowest_s = 0.1;  // of an image that is read row by row
  if (const double read_s = camera.line_delay_s * lens.height; read_s > kSlowest_s)
    doubt(fmt::format("line_delay: it takes {:.3g} s to read an image: is it in seconds?", read_s));
  return doubts;
}

std::vector<std::string> doubts_about(const ImuNoise& noise, const std::filesystem::path& file) {
  constexpr double kNoisiestGyro = 0.1, kNoisiestAccel = 1;  // rad/s, m/s2, per sqrt(Hz)
  std::vector<std::string> doubts;
  const auto doubt = [&](const char* key, double density, const char* unit) {
    doubts.push_back(
        fmt::format("{}: {} of {:.4g}: is it in {}?", file.string(), key, density, unit));
  };
  if (noise.gyro_density > kNoisiestGyro)
    doubt("gyroscope_noise_density", noise.gyro_density, "rad/s/sqrt(Hz)");
  if (noise.accel_density > kNoisiestAccel)
    doubt("accelerometer_noise_density", noise.accel_density, "m/s2/sqrt(Hz)");
  return doubts;
}

}  // namespace covey
