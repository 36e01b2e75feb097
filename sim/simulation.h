// SPDX-License-Identifier: Apache-2.0
//
// A whole flight of a team: plans, inertial data, truth and images, ready to be written or used in
// a test. Every drone draws its random numbers from its own stream: the order in which drones are
// rendered does not change a bit.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "sim/dataset_writer.h"
#include "sim/imu.h"
#include "sim/recorded_flight.h"
#include "sim/renderer.h"
#include "sim/scenario_motion.h"
#include "sim/scene.h"
#include "sim/thermal_camera.h"
#include "sim/visual_camera.h"

namespace covey {

struct SimulationRequest {
  Scenario scenario = Scenario::kCastleParallel;
  std::uint64_t seed = 1;
  int agents = 0;         // 0: as the scenario says
  double duration_s = 0;  // s; 0: as the scenario or the recording says
  double camera_rate_hz = 30;
  std::optional<CameraIntrinsics> camera;  // empty: the scenario's own
  double line_delay_s = 0;                 // s, see CameraDescription
  std::optional<ImuNoise> imu_noise;       // empty: the scenario's own; not of recorded IMUs
  std::optional<double> imu_rate_hz;       // empty: 200
  double lap_m = 0;                        // m, see FlightRequest
  int legs = 1;                            // see FlightRequest; visual, global shutter only
  bool shutter_events = false;             // thermal cameras only
  double least_span_k = 0;  // K, thermal cameras only: ThermalSensor::min_range_k; 0: its own
  int texture_size = 4096;  // texels; smaller in quick tests
  std::vector<RecordedFlight> recorded;
};

struct SimulatedImage {
  cv::Mat grey;   // CV_8UC1
  cv::Mat raw16;  // CV_16UC1, thermal cameras only, otherwise empty
};

// One drone's sensors. Images come in order, each once.
class DroneSimulation {
 public:
  struct Plan {
    DronePlan flight;
    TimeNs start_ns = 0;  // stamp of the trajectory's time 0
    bool thermal = false;
    bool shutter_events = false;
    ThermalSensor thermal_sensor;
    double camera_rate_hz = 30;
    double line_delay_s = 0;
    std::size_t images_of_leg = 0;  // of flights there and back; 0: one way
    std::uint64_t seed = 1;
    ImuRecording imu;  // with true biases
    ImuNoise imu_noise;
    double imu_rate_hz = 200;
    std::string imu_comment;
  };

  DroneSimulation(Plan plan, std::shared_ptr<const Scene> scene,
                  std::shared_ptr<const Renderer> renderer);

  [[nodiscard]] const std::string& name() const { return plan_.flight.name; }
  [[nodiscard]] const Plan& plan() const { return plan_; }
  [[nodiscard]] const std::vector<TimeNs>& image_stamps() const { return image_stamps_; }
  [[nodiscard]] CameraDescription camera() const;
  [[nodiscard]] std::vector<TrueState> true_states() const;  // at the IMU stamps

  [[nodiscard]] Eigen::Isometry3d camera_pose(TimeNs stamp_ns) const;  // T_world_cam
  // The earliest image taken from the same place as image `index`: one on the way there, or itself.
  [[nodiscard]] std::size_t first_seen(std::size_t index) const;
  [[nodiscard]] SimulatedImage next_image();
  void skip_images(std::size_t count) { next_ += count; }
  // Of the last image; null for a visual camera.
  [[nodiscard]] const ThermalTruth* thermal_truth() const {
    return thermal_ ? &thermal_->truth() : nullptr;
  }

  [[nodiscard]] const Scene& scene() const { return *scene_; }
  [[nodiscard]] const Renderer& renderer() const { return *renderer_; }

 private:
  [[nodiscard]] Rendering rendered(TimeNs stamp_ns) const;
  [[nodiscard]] KinematicState state_at(TimeNs stamp_ns) const;
  [[nodiscard]] CameraMotion motion_at(const KinematicState& state) const;

  Plan plan_;
  std::shared_ptr<const Scene> scene_;
  std::shared_ptr<const Renderer> renderer_;
  Eigen::Isometry3d T_imu_cam_ = Eigen::Isometry3d::Identity();
  std::vector<TimeNs> image_stamps_;
  std::size_t next_ = 0;
  std::optional<VisualCamera> visual_;
  std::optional<ThermalCamera> thermal_;
};

[[nodiscard]] CameraIntrinsics visual_intrinsics();   // 752x480, f = 455 px, radial-tangential
[[nodiscard]] CameraIntrinsics thermal_intrinsics();  // 640x512, 95 degrees wide, equidistant

// Throws std::runtime_error with one line for a request that cannot be flown.
[[nodiscard]] std::vector<DroneSimulation> make_simulation(const SimulationRequest& request);

}  // namespace covey
