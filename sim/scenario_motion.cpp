// SPDX-License-Identifier: Apache-2.0
#include "sim/scenario_motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "sim/random.h"

namespace covey {
namespace {

constexpr double kHover_s = 1.0;

struct ScenarioFacts {
  Scenario scenario;
  std::string_view name;
  int agents;
  double duration_s;
};
constexpr std::array<ScenarioFacts, 4> kScenarios{{
    {Scenario::kCastleAround, "castle_around", 4, 30.0},
    {Scenario::kCastleParallel, "castle_parallel", 3, 9.0},
    {Scenario::kMarsYard, "mars_yard", 2, 20.0},
    {Scenario::kRoom, "room", 2, 30.0},
}};

const ScenarioFacts& facts(Scenario scenario) {
  return *std::find_if(kScenarios.begin(), kScenarios.end(),
                       [&](const ScenarioFacts& f) { return f.scenario == scenario; });
}

// 0 before 0, 1 after 1, two continuous derivatives.
double smooth_step(double x) {
  const double c = std::clamp(x, 0.0, 1.0);
  return c * c * c * (10 + c * (6 * c - 15));
}

// Stand still, speed up smoothly, cruise.
struct SpeedProfile {
  double hover_s = kHover_s;
  double ramp_s = 2.0;
  double cruise = 1.0;  // m/s

  // Cruise speed such that `length_m` are flown in `duration_s`.
  static SpeedProfile covering(double length_m, double duration_s, double ramp_s) {
    return {kHover_s, ramp_s, length_m / (duration_s - kHover_s - ramp_s / 2)};
  }

  [[nodiscard]] double distance(double time_s) const {
    const double x = (time_s - hover_s) / ramp_s;
    if (x <= 0) return 0;
    if (x >= 1) return cruise * ramp_s * (x - 0.5);
    return cruise * ramp_s * x * x * x * x * (2.5 + x * (x - 3));  // integral of smooth_step
  }
};

// Closed curve |x|^n + |y|^n = a^n, a square with rounded corners, walked by arc length.
class RoundedSquare {
 public:
  RoundedSquare(double perimeter_m, double exponent) : exponent_(exponent) {
    lengths_.push_back(0);
    Eigen::Vector2d previous = unit_point(0);
    for (int i = 1; i <= kSteps; ++i) {
      const Eigen::Vector2d point = unit_point(2 * M_PI * i / kSteps);
      lengths_.push_back(lengths_.back() + (point - previous).norm());
      previous = point;
    }
    scale_ = perimeter_m / lengths_.back();
    for (double& length : lengths_) length *= scale_;
  }

  [[nodiscard]] Eigen::Vector2d point_at(double distance_m) const {
    const double perimeter = lengths_.back();
    const double s = distance_m - perimeter * std::floor(distance_m / perimeter);
    const auto next = std::upper_bound(lengths_.begin() + 1, lengths_.end() - 1, s);
    const double share = (s - *(next - 1)) / (*next - *(next - 1));
    const double steps = static_cast<double>(next - 1 - lengths_.begin()) + share;
    return scale_ * unit_point(2 * M_PI * steps / kSteps);
  }

 private:
  static constexpr int kSteps = 4096;

  [[nodiscard]] Eigen::Vector2d unit_point(double angle) const {
    const double c = std::cos(angle), s = std::sin(angle);
    const double sum = std::pow(std::abs(c), exponent_) + std::pow(std::abs(s), exponent_);
    return Eigen::Vector2d(c, s) / std::pow(sum, 1 / exponent_);
  }

  double exponent_;
  double scale_ = 1;
  std::vector<double> lengths_;  // m, from angle 0
};

// Gusts and a pilot's hand: a few sinusoids on each axis and on yaw, slight while hovering.
class Wobble {
 public:
  struct Size {
    double position_m = 0.05;  // of the slowest sinusoid; faster ones shrink with their frequency
    double yaw = 0.05;         // rad
  };

  Wobble(Random& random, const Size& size) {
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
      const double amplitude = axis == 3 ? size.yaw : size.position_m;
      for (std::size_t k = 0; k < kSines; ++k) {
        const double hz = 0.3 * std::pow(2.0, static_cast<double>(k)) * random.uniform(0.75, 1.35);
        // Falls with the frequency squared: each sinusoid asks for the same acceleration.
        const double size_at_hz = amplitude * (0.3 / hz) * (0.3 / hz);
        sines_[axis][k] = {size_at_hz, 2 * M_PI * hz, random.uniform(0, 2 * M_PI)};
      }
    }
  }

  [[nodiscard]] FlatOutput at(double time_s) const {
    constexpr double kHoverShare = 0.05;
    const double envelope = kHoverShare + (1 - kHoverShare) * smooth_step((time_s - kHover_s) / 2);
    std::array<double, kAxes> sum{};
    for (std::size_t axis = 0; axis < kAxes; ++axis) {
      for (const Sine& sine : sines_[axis]) {
        sum[axis] += envelope * sine.amplitude * std::sin(sine.rate * time_s + sine.phase);
      }
    }
    return {Eigen::Vector3d(sum[0], sum[1], sum[2]), sum[3]};
  }

 private:
  static constexpr std::size_t kAxes = 4;  // x, y, z, yaw
  static constexpr std::size_t kSines = 3;
  struct Sine {
    double amplitude = 0, rate = 0, phase = 0;
  };
  std::array<std::array<Sine, kSines>, kAxes> sines_{};
};

struct Drone {
  int index = 0;
  int agents = 1;
  double duration_s = 0;
  double nominal_s = 0;  // the scenario's own duration, which sets the speed
  int legs = 1;

  // Evenly spread over 0..1, the middle of the drone's share.
  [[nodiscard]] double share() const { return (index + 0.5) / agents; }
};

FlatOutput operator+(const FlatOutput& a, const FlatOutput& b) {
  return {a.p_world_imu + b.p_world_imu, a.yaw + b.yaw};
}

// The path, walked to its end in `leg_s`, back in the same time, and again: the pose at a time is
// that at the same time before or after a turn.
FlatPath there_and_back(const FlatPath& path, double leg_s) {
  const SpeedProfile clock{0, 2.0, 1.0};  // of the path's own time
  const double half = clock.distance(leg_s / 2);
  return [=](double t) {
    const double in_round = t - 2 * leg_s * std::floor(t / (2 * leg_s));
    const double from_start = std::min(in_round, 2 * leg_s - in_round);
    return path(from_start < leg_s / 2 ? clock.distance(from_start)
                                       : 2 * half - clock.distance(leg_s - from_start));
  };
}

DronePlan plan(const Drone& drone, const FlatPath& path, const CameraExtrinsics& extrinsics) {
  const FlatPath flown = drone.legs > 1 ? there_and_back(path, drone.duration_s) : path;
  return {"uav" + std::to_string(drone.index),
          Trajectory::multirotor(flown, drone.legs * drone.duration_s), extrinsics};
}

// A lap of 220 m at its own height and from its own start, sideways, the castle in view.
DronePlan castle_around(const Drone& drone, Random& random) {
  const double exponent = random.uniform(3.2, 3.8);
  const RoundedSquare lap(220 * random.uniform(0.985, 1.015), exponent);
  const SpeedProfile speed = SpeedProfile::covering(220, drone.nominal_s, 3.5);
  const Wobble wobble(random, {0.08, 0.05});
  const double start_m = 220 * (drone.share() + random.uniform(-0.08, 0.08));
  const double height = 4 + 10 * drone.share() + random.uniform(-0.8, 0.8);
  const double yaw_offset = random.uniform(-0.3, 0.3);
  const double climb_phase = random.uniform(0, 2 * M_PI);
  const FlatPath path = [=](double t) {
    const double s = speed.distance(t);
    const Eigen::Vector2d xy = lap.point_at(start_m + s);
    const double z = height + 0.6 * std::sin(2 * M_PI * s / 90 + climb_phase);
    const double to_centre = std::atan2(-xy.y(), -xy.x());
    return FlatOutput{{xy.x(), xy.y(), z}, to_centre + yaw_offset} + wobble.at(t);
  };
  return plan(drone, path, mounted_camera(0.07));
}

// Side by side along the facade, 30 m from west to east, looking north at it.
DronePlan castle_parallel(const Drone& drone, Random& random, double team_height) {
  const SpeedProfile speed = SpeedProfile::covering(30, drone.nominal_s, 2.0);
  const Wobble wobble(random, {0.08, 0.05});
  const double south_m = 15 + 9 + 3 * drone.index + random.uniform(-0.5, 0.5);
  const Eigen::Vector3d start(-15 + random.uniform(-1.5, 1.5), -south_m, team_height);
  const double yaw = M_PI / 2 + random.uniform(-0.15, 0.15);
  const FlatPath path = [=](double t) {
    const Eigen::Vector3d p = start + Eigen::Vector3d(speed.distance(t), 0, 0);
    return FlatOutput{p, yaw} + wobble.at(t);
  };
  return plan(drone, path, mounted_camera(0.07));
}

// A square lap over the yard, small and low or large and high; heading kept but for a slow swing.
// `lap_m`: 0 for the laps of the paper's flight.
DronePlan mars_yard(const Drone& drone, Random& random, double lap_m) {
  const bool wide = drone.index % 2 == 1;
  const double length = lap_m > 0 ? lap_m : (wide ? 18 : 11);
  const int pair = drone.index / 2;
  const double height = (wide ? 4.0 : 2.5) + 0.6 * pair + random.uniform(-0.2, 0.2);
  const double exponent = random.uniform(3.5, 4.5);
  const RoundedSquare lap(length * random.uniform(0.98, 1.02), exponent);
  const SpeedProfile speed = SpeedProfile::covering(length, drone.nominal_s, 1.5);
  const Wobble wobble(random, {0.04, 0.04});
  const double centre_y = random.uniform(-0.7, 0.7);
  const Eigen::Vector2d centre(random.uniform(-0.7, 0.7), centre_y);
  const double start_m = length * random.unit();
  const double heading = random.uniform(-0.5, 0.5);
  const FlatPath path = [=](double t) {
    const double s = speed.distance(t);
    const Eigen::Vector2d xy = centre + lap.point_at(start_m + s);
    const double yaw = heading + 0.35 * std::sin(2 * M_PI * s / length);
    return FlatOutput{{xy.x(), xy.y(), height}, yaw} + wobble.at(t);
  };
  return plan(drone, path, mounted_camera(1.3));
}

// Smooth wandering through a room, looking around.
DronePlan room(const Drone& drone, Random& random) {
  const SpeedProfile speed{kHover_s, 2.0, 1.0};  // "distance" is time in motion here, s
  const Wobble wobble(random, {0.05, 0.05});
  const Eigen::Vector3d size(2.3, 1.8, 0.6);
  std::array<double, 4> rate{}, phase{};
  for (std::size_t k = 0; k < rate.size(); ++k) {
    rate[k] = 2 * M_PI * random.uniform(0.06, 0.11);
    phase[k] = random.uniform(0, 2 * M_PI);
  }
  const FlatPath path = [=](double t) {
    const double s = speed.distance(t);
    const Eigen::Vector3d swing(std::sin(rate[0] * s + phase[0]), std::sin(rate[1] * s + phase[1]),
                                std::sin(rate[2] * s + phase[2]));
    const Eigen::Vector3d p = Eigen::Vector3d(0, 0, 1.5) + size.cwiseProduct(swing);
    return FlatOutput{p, 1.8 * std::sin(0.5 * rate[3] * s + phase[3])} + wobble.at(t);
  };
  return plan(drone, path, mounted_camera(0.05));
}

std::vector<DronePlan> plan_recorded(const FlightRequest& request) {
  const auto flown = static_cast<int>(request.recorded.size());
  if (request.agents != 0 && request.agents != flown) {
    throw std::runtime_error("simulate: " + std::to_string(request.agents) + " agents but " +
                             std::to_string(flown) +
                             " recorded trajectories; give one for each drone");
  }
  std::vector<DronePlan> plans;
  for (const Trajectory& recorded : request.recorded) {
    const double duration_s = request.duration_s > 0 ? request.duration_s : recorded.duration_s();
    plans.push_back(
        {"uav" + std::to_string(plans.size()), recorded.first_seconds(duration_s), euroc_camera()});
  }
  return plans;
}

}  // namespace

std::optional<Scenario> scenario_from_name(std::string_view name) {
  for (const ScenarioFacts& f : kScenarios) {
    if (f.name == name) return f.scenario;
  }
  return std::nullopt;
}

std::string_view scenario_name(Scenario scenario) { return facts(scenario).name; }
int default_agents(Scenario scenario) { return facts(scenario).agents; }
double default_duration_s(Scenario scenario) { return facts(scenario).duration_s; }

CameraExtrinsics mounted_camera(double pitch_down) {
  Eigen::Matrix3d R_level_cam;  // columns: camera right, down, forward in a level x-forward body
  R_level_cam << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  CameraExtrinsics extrinsics;
  extrinsics.q_imu_cam = Eigen::Quaterniond(
      Eigen::AngleAxisd(pitch_down, Eigen::Vector3d::UnitY()).toRotationMatrix() * R_level_cam);
  extrinsics.p_imu_cam = {0.09, 0.02, -0.03};
  return extrinsics;
}

CameraExtrinsics euroc_camera() {
  Eigen::Matrix3d R_imu_cam;
  R_imu_cam << 0.0148655429818, -0.999880929698, 0.00414029679422, 0.999557249008, 0.0149672133247,
      0.025715529948, -0.0257744366974, 0.00375618835797, 0.999660727178;
  CameraExtrinsics extrinsics;
  extrinsics.q_imu_cam = Eigen::Quaterniond(R_imu_cam).normalized();
  extrinsics.p_imu_cam = {-0.0216401454975, -0.064676986768, 0.00981073058949};
  return extrinsics;
}

std::vector<DronePlan> plan_flights(const FlightRequest& request) {
  constexpr double kShortest_s = 1.0;
  constexpr int kMostAgents = 64;
  if (request.agents < 0 || request.agents > kMostAgents) {
    throw std::runtime_error("simulate: the number of agents must be 1 to 64");
  }
  if (request.duration_s != 0 && !(request.duration_s >= kShortest_s)) {
    throw std::runtime_error("simulate: a flight must last at least 1 s");
  }
  if (request.legs < 1) throw std::runtime_error("simulate: a flight has at least one leg");
  if (!request.recorded.empty()) {
    if (request.legs > 1) throw std::runtime_error("simulate: --legs is not for recorded motion");
    return plan_recorded(request);
  }

  Drone drone;
  drone.agents = request.agents > 0 ? request.agents : default_agents(request.scenario);
  drone.nominal_s = default_duration_s(request.scenario);
  drone.legs = request.legs;
  drone.duration_s = request.duration_s > 0 ? request.duration_s : drone.nominal_s;
  if (request.lap_m != 0) {
    if (request.scenario != Scenario::kMarsYard || !(request.lap_m >= 5 && request.lap_m <= 100)) {
      throw std::runtime_error("simulate: --lap is for mars_yard, 5 to 100 m");
    }
    drone.nominal_s = drone.duration_s;
  }
  const double team_height = Random(request.seed).uniform(5, 8);
  std::vector<DronePlan> plans;
  for (; drone.index < drone.agents; ++drone.index) {
    Random random(request.seed, static_cast<std::uint64_t>(drone.index) + 1);
    switch (request.scenario) {
      case Scenario::kCastleAround:
        plans.push_back(castle_around(drone, random));
        break;
      case Scenario::kCastleParallel:
        plans.push_back(castle_parallel(drone, random, team_height));
        break;
      case Scenario::kMarsYard:
        plans.push_back(mars_yard(drone, random, request.lap_m));
        break;
      case Scenario::kRoom:
        plans.push_back(room(drone, random));
        break;
    }
  }
  return plans;
}

}  // namespace covey
