// SPDX-License-Identifier: Apache-2.0
#include "sim/simulation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace covey {
namespace {

constexpr TimeNs kStart_ns =
    1'000'000'000'000;  // of simulated flights; any value but zero would do

using Box = Eigen::AlignedBox3d;

Box bounds_of(const Trajectory& trajectory) {
  Box box;
  const int steps = 1 + static_cast<int>(trajectory.duration_s() / 0.05);
  for (int i = 0; i <= steps; ++i)
    box.extend(trajectory.pose_at(trajectory.duration_s() * i / steps).p_world_imu);
  return box;
}

// Recorded samples with the ground truth's biases beside them.
ImuRecording recorded_imu(const RecordedFlight& flight) {
  ImuRecording recording;
  recording.samples = flight.imu;
  auto state = flight.states.begin();
  for (const ImuSample& sample : flight.imu) {
    while (state + 1 != flight.states.end() && (state + 1)->stamp_ns <= sample.stamp_ns) ++state;
    recording.biases.push_back({state->gyro_bias, state->accel_bias});
  }
  return recording;
}

Scene make_scene(const SimulationRequest& request, const std::vector<DronePlan>& flights) {
  const SceneOptions options{request.seed, request.texture_size};
  switch (request.scenario) {
    case Scenario::kCastleAround:
    case Scenario::kCastleParallel:
      return make_castle(options);
    case Scenario::kMarsYard:
      return make_mars_yard(options);
    case Scenario::kRoom:
      break;
  }
  Box box;
  for (const DronePlan& flight : flights) box.extend(bounds_of(flight.trajectory));
  return make_room(options, box.min(), box.max());
}

std::vector<RecordedFlight> prepare_recorded(const SimulationRequest& request) {
  std::vector<RecordedFlight> recorded = request.recorded;
  if (!recorded.empty() && request.scenario != Scenario::kRoom)
    throw std::runtime_error("simulate: recorded trajectories are flown in the scenario 'room'");
  for (RecordedFlight& flight : recorded) {
    const bool keeps_imu = !flight.imu.empty();
    keep_first_seconds(flight, request.duration_s);
    if (keeps_imu && flight.imu.size() < 2)
      throw std::runtime_error(
          "simulate: the recorded IMU does not overlap its ground truth in time");
  }
  move_into_one_room(recorded);
  return recorded;
}

ThermalSensor thermal_sensor(const SimulationRequest& request) {
  ThermalSensor sensor;
  if (request.least_span_k > 0) sensor.min_range_k = request.least_span_k;
  return sensor;
}

CameraIntrinsics intrinsics_of(const SimulationRequest& request, bool thermal) {
  if (request.camera) return *request.camera;
  return thermal ? thermal_intrinsics() : visual_intrinsics();
}

// What a thermal pixel without light would read, nobody says.
void require_lit(const Renderer& renderer) {
  const CameraIntrinsics& camera = renderer.camera();
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x)
      if (!renderer.is_lit(x, y))
        throw std::runtime_error(
            "simulate: --camera: a thermal camera's lens has to reach all of its image, and does "
            "not reach pixel (" +
            std::to_string(x) + ", " + std::to_string(y) + ")");
}

ImuSensor imu_sensor(const SimulationRequest& request, bool thermal) {
  ImuSensor sensor = thermal ? icm20608() : adis16448();
  if (request.imu_noise) sensor.noise = *request.imu_noise;
  if (request.imu_rate_hz) sensor.rate_hz = *request.imu_rate_hz;
  return sensor;
}

// Whole hertz: stamps are not that even.
double mean_rate_hz(const std::vector<ImuSample>& samples) {
  const double span_s = seconds_between(samples.front().stamp_ns, samples.back().stamp_ns);
  return std::round(static_cast<double>(samples.size() - 1) / span_s);
}

// 0 for flights one way.
std::size_t images_of_leg(const SimulationRequest& request) {
  if (request.legs <= 1) return 0;
  if (request.scenario == Scenario::kMarsYard)
    throw std::runtime_error("simulate: --legs is not for thermal cameras, which change in time");
  if (request.line_delay_s != 0)
    throw std::runtime_error(
        "simulate: --legs is not for rolling shutters, whose images differ on the way back");
  const double leg_s =
      request.duration_s > 0 ? request.duration_s : default_duration_s(request.scenario);
  const double images = leg_s * request.camera_rate_hz;
  if (std::abs(images - std::round(images)) > 1e-6)
    throw std::runtime_error(
        "simulate: --legs needs a whole number of images in each: --seconds times --rate");
  return static_cast<std::size_t>(std::llround(images));
}

}  // namespace

CameraIntrinsics visual_intrinsics() {
  return {752,
          480,
          455,
          455,
          375.5,
          239.5,
          DistortionModel::kRadialTangential,
          {-0.28, 0.07, 2e-4, 2e-5}};
}

// fx makes the image 95 degrees wide: 320 px = fx * theta_d(47.5 degrees).
CameraIntrinsics thermal_intrinsics() {
  return {640,
          512,
          389.5,
          389.5,
          319.5,
          255.5,
          DistortionModel::kEquidistant,
          {-0.012, -0.004, 0.001, -0.0002}};
}

DroneSimulation::DroneSimulation(Plan plan, std::shared_ptr<const Scene> scene,
                                 std::shared_ptr<const Renderer> renderer)
    : plan_(std::move(plan)), scene_(std::move(scene)), renderer_(std::move(renderer)) {
  const CameraExtrinsics& extrinsics = plan_.flight.extrinsics;
  T_imu_cam_.linear() = extrinsics.q_imu_cam.toRotationMatrix();
  T_imu_cam_.translation() = extrinsics.p_imu_cam;

  // Cameras are not triggered by the IMU: every drone has its own phase. With half an interval,
  // images lie at the same times before and after a turn.
  Random random(plan_.seed, 401);
  const double phase_s = plan_.images_of_leg > 0
                             ? 0.5 / plan_.camera_rate_hz
                             : random.uniform(0.005, 0.95 / plan_.camera_rate_hz);
  for (std::int64_t k = 0;; ++k) {
    const double time_s = phase_s + static_cast<double>(k) / plan_.camera_rate_hz;
    const TimeNs stamp_ns = plan_.start_ns + nanoseconds(time_s);
    if (stamp_ns > plan_.imu.samples.back().stamp_ns) break;
    if (stamp_ns >= plan_.imu.samples.front().stamp_ns) image_stamps_.push_back(stamp_ns);
  }
  if (plan_.thermal)
    thermal_.emplace(renderer_->camera(), plan_.thermal_sensor, plan_.seed, plan_.shutter_events);
  else
    visual_.emplace(renderer_->camera(), VisualSensor{}, plan_.seed);
}

CameraDescription DroneSimulation::camera() const {
  return {renderer_->camera(), plan_.flight.extrinsics, plan_.camera_rate_hz, plan_.line_delay_s,
          plan_.thermal ? "simulated thermal camera, automatic gain" : "simulated grey camera"};
}

KinematicState DroneSimulation::state_at(TimeNs stamp_ns) const {
  return plan_.flight.trajectory.at(seconds_between(plan_.start_ns, stamp_ns));
}

std::vector<TrueState> DroneSimulation::true_states() const {
  std::vector<TrueState> states;
  for (std::size_t i = 0; i < plan_.imu.samples.size(); ++i) {
    const TimeNs stamp_ns = plan_.imu.samples[i].stamp_ns;
    const KinematicState state = state_at(stamp_ns);
    const ImuBias& bias = plan_.imu.biases[i];
    states.push_back({stamp_ns, state.pose, state.v_world_imu, bias.gyro, bias.accel});
  }
  return states;
}

Eigen::Isometry3d DroneSimulation::camera_pose(TimeNs stamp_ns) const {
  const Pose pose = state_at(stamp_ns).pose;
  Eigen::Isometry3d T_world_imu = Eigen::Isometry3d::Identity();
  T_world_imu.linear() = pose.q_world_imu.toRotationMatrix();
  T_world_imu.translation() = pose.p_world_imu;
  return T_world_imu * T_imu_cam_;
}

CameraMotion DroneSimulation::motion_at(const KinematicState& state) const {
  const Eigen::Matrix3d R_cam_imu = T_imu_cam_.linear().transpose();
  const Eigen::Vector3d v_imu = state.pose.q_world_imu.conjugate() * state.v_world_imu +
                                state.omega_imu.cross(T_imu_cam_.translation());
  return {(R_cam_imu * v_imu).cast<float>(), (R_cam_imu * state.omega_imu).cast<float>()};
}

std::size_t DroneSimulation::first_seen(std::size_t index) const {
  if (plan_.images_of_leg == 0) return index;
  const std::size_t leg = index / plan_.images_of_leg, place = index % plan_.images_of_leg;
  return leg % 2 == 0 ? place : plan_.images_of_leg - 1 - place;
}

Rendering DroneSimulation::rendered(TimeNs stamp_ns) const {
  if (plan_.line_delay_s == 0) return renderer_->render(*scene_, camera_pose(stamp_ns));
  const int height = renderer_->camera().height;
  const ImuRecording& imu = plan_.imu;
  return renderer_->render(*scene_, [&](int y) {
    const TimeNs later_ns = nanoseconds(plan_.line_delay_s * (y - 0.5 * (height - 1)));
    return camera_pose(
        std::clamp(stamp_ns + later_ns, imu.samples.front().stamp_ns, imu.samples.back().stamp_ns));
  });
}

SimulatedImage DroneSimulation::next_image() {
  const TimeNs stamp_ns = image_stamps_.at(next_++);
  const double since_last_s = 1 / plan_.camera_rate_hz;
  const Rendering sharp = rendered(stamp_ns);
  const CameraMotion motion = motion_at(state_at(stamp_ns));
  if (thermal_) {
    const TemporalResponse lag{TemporalResponse::Shape::kExponentialLag,
                               plan_.thermal_sensor.time_constant_s};
    const auto image =
        thermal_->expose(renderer_->blur_by_motion(sharp, motion, lag), since_last_s);
    return {image.grey, image.raw16};
  }
  const TemporalResponse shutter{TemporalResponse::Shape::kShutter, VisualSensor{}.exposure_s};
  return {visual_->expose(renderer_->blur_by_motion(sharp, motion, shutter), since_last_s), {}};
}

std::vector<DroneSimulation> make_simulation(const SimulationRequest& request) {
  if (!(request.camera_rate_hz >= 1 && request.camera_rate_hz <= 200))
    throw std::runtime_error("simulate: --rate must be 1 to 200 Hz");
  const std::size_t leg_images = images_of_leg(request);
  const std::vector<RecordedFlight> recorded = prepare_recorded(request);
  FlightRequest flights{request.scenario,
                        request.seed,
                        request.agents,
                        request.duration_s,
                        request.lap_m,
                        request.legs,
                        {}};
  for (const RecordedFlight& flight : recorded) flights.recorded.push_back(fly_again(flight));
  const std::vector<DronePlan> plans = plan_flights(flights);

  const bool thermal = request.scenario == Scenario::kMarsYard;
  const auto scene = std::make_shared<const Scene>(make_scene(request, plans));
  const auto renderer = std::make_shared<const Renderer>(intrinsics_of(request, thermal));
  if (thermal) require_lit(*renderer);
  std::vector<DroneSimulation> drones;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    const bool keeps_imu = i < recorded.size() && !recorded[i].imu.empty();
    const ImuSensor sensor = imu_sensor(request, thermal);
    const std::uint64_t seed = request.seed * 1000 + i;
    DroneSimulation::Plan plan{plans[i],
                               keeps_imu ? recorded[i].states.front().stamp_ns : kStart_ns,
                               thermal,
                               request.shutter_events,
                               thermal_sensor(request),
                               request.camera_rate_hz,
                               request.line_delay_s,
                               leg_images,
                               seed,
                               {},
                               sensor.noise,
                               sensor.rate_hz,
                               thermal ? "simulated ICM20608" : "simulated ADIS16448"};
    if (keeps_imu) {
      plan.imu = recorded_imu(recorded[i]);
      plan.imu_rate_hz = mean_rate_hz(plan.imu.samples);
      plan.imu_comment = "recorded ADIS16448";
    } else {
      plan.imu = simulate_imu(plans[i].trajectory, sensor, seed, kStart_ns);
    }
    drones.emplace_back(std::move(plan), scene, renderer);
  }
  return drones;
}

}  // namespace covey
