// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate_command.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "apps/dataset.h"
#include "apps/number_range.h"
#include "apps/png_file.h"
#include "apps/progress.h"
#include "apps/recorded_flight.h"
#include "apps/sensor_file.h"
#include "apps/stop_signal.h"
#include "apps/thermal_truth_file.h"
#include "sim/dataset_writer.h"
#include "sim/simulation.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct Options {
  std::string scenario;
  std::string out;
  SimulationRequest request;
  RecordedFiles recordings;
  std::string camera;     // sensor.yaml
  std::string imu_noise;  // sensor.yaml
  bool raw16 = false;
  bool force = false;
};

void write_drone(const fs::path& mav0, DroneSimulation& drone, bool raw16,
                 const std::atomic<bool>& stop, std::atomic<std::size_t>& images_done) {
  const CameraDescription camera = drone.camera();
  const DroneSimulation::Plan& plan = drone.plan();
  write_camera_file(mav0 / "cam0" / "sensor.yaml", camera);
  write_imu_file(mav0 / "imu0" / "sensor.yaml", plan.imu_noise, plan.imu_rate_hz, plan.imu_comment);
  write_imu_csv(mav0 / "imu0" / "data.csv", plan.imu.samples);
  write_ground_truth_csv(ground_truth_file(mav0), drone.true_states());

  ImageList list(mav0 / "cam0");
  std::optional<ImageList> raw_list;
  if (raw16 && plan.thermal) {
    write_camera_file(mav0 / "cam0raw16" / "sensor.yaml", camera);
    raw_list.emplace(mav0 / "cam0raw16");
  }
  std::optional<ThermalTruthWriter> truth;
  if (plan.thermal) truth.emplace(mav0);
  std::vector<fs::path> files;
  for (const TimeNs stamp_ns : drone.image_stamps()) {
    if (stop) return;
    files.push_back(list.add(stamp_ns));
    if (const std::size_t twin = drone.first_seen(files.size() - 1); twin + 1 < files.size()) {
      fs::create_hard_link(files[twin], files.back());
      drone.skip_images(1);
    } else {
      const SimulatedImage image = drone.next_image();
      write_png(files.back().string(), image.grey);
      if (raw_list) write_png(raw_list->add(stamp_ns).string(), image.raw16);
      if (truth) truth->write(stamp_ns, *drone.thermal_truth());
    }
    ++images_done;
  }
  list.close();
  if (raw_list) raw_list->close();
  if (truth) truth->close();
}

// Renders the drones on a few threads, one drone at a time on each; the result does not depend on
// how they take turns.
class RenderingCrew {
 public:
  RenderingCrew(std::vector<DroneSimulation>& drones, const fs::path& folder, bool raw16)
      : drones_(drones), folder_(folder), raw16_(raw16) {
    constexpr std::size_t kMostThreads = 2;
    const std::size_t cores = std::max(1u, std::thread::hardware_concurrency());
    working_ = std::min({drones.size(), cores, kMostThreads});
    for (std::size_t i = 0; i < working_; ++i) threads_.emplace_back([this] { work(); });
  }
  ~RenderingCrew() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
  }
  RenderingCrew(const RenderingCrew&) = delete;
  RenderingCrew& operator=(const RenderingCrew&) = delete;

  // Returns when all is rendered; throws what went wrong.
  void wait(Progress& progress) {
    std::unique_lock lock(mutex_);
    while (working_ > 0 && !failure_ && !stop_requested()) {
      progress.show(images_done_);
      finished_.wait_for(lock, std::chrono::milliseconds(100));
    }
    if (failure_) std::rethrow_exception(failure_);
    if (stop_requested())
      throw std::runtime_error("simulate: interrupted, nothing has been written");
    progress.show(images_done_);
  }

 private:
  void work() {
    try {
      for (std::size_t i = next_drone_++; i < drones_.size() && !stop_; i = next_drone_++)
        write_drone(folder_ / drones_[i].name() / "mav0", drones_[i], raw16_, stop_, images_done_);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      failure_ = std::current_exception();
    }
    const std::lock_guard lock(mutex_);
    --working_;
    finished_.notify_one();
  }

  std::vector<DroneSimulation>& drones_;
  const fs::path& folder_;
  bool raw16_;
  std::mutex mutex_;
  std::condition_variable finished_;
  std::size_t working_ = 0;     // guarded by mutex_
  std::exception_ptr failure_;  // guarded by mutex_
  std::atomic<bool> stop_{false};
  std::atomic<std::size_t> next_drone_{0}, images_done_{0};
  std::vector<std::thread> threads_;
};

void read_recordings(Options& options) {
  options.request.recorded = read_recorded_flights(options.recordings, "simulate");
  for (std::size_t i = 0; i < options.request.recorded.size(); ++i) {
    const std::vector<TrueState>& states = options.request.recorded[i].states;
    const double recorded_s = seconds_between(states.front().stamp_ns, states.back().stamp_ns);
    if (options.request.duration_s > recorded_s)
      spdlog::warn("{}: lasts {:.1f} s, not {:g}: so long uav{} flies",
                   options.recordings.trajectories[i], recorded_s, options.request.duration_s, i);
  }
}

void read_sensor_files(Options& options) {
  if (!options.camera.empty()) {
    const CameraCalibration camera = read_camera_file(options.camera);
    for (const std::string& doubt : doubts_about(camera, options.camera)) spdlog::warn("{}", doubt);
    options.request.camera = camera.intrinsics;
    options.request.line_delay_s = camera.line_delay_s;
  }
  if (!options.imu_noise.empty()) {
    options.request.imu_noise = read_imu_file(options.imu_noise);
    for (const std::string& doubt : doubts_about(*options.request.imu_noise, options.imu_noise))
      spdlog::warn("{}", doubt);
  }
  if (!options.recordings.imus.empty() &&
      (options.request.imu_noise || options.request.imu_rate_hz))
    throw std::runtime_error(
        "simulate: --imu-noise and --imu-rate are for simulated IMUs, --imu is a recorded one");
}

// Nobody flies a dataset without images. Only a recording can be so short.
void require_images(const std::vector<DroneSimulation>& drones, const Options& options) {
  for (std::size_t i = 0; i < drones.size(); ++i) {
    if (!drones[i].image_stamps().empty()) continue;
    throw std::runtime_error(fmt::format(
        "{}: ends before the first image, of which there are {:g} per second: fly more of it, or "
        "more images (--rate)",
        i < options.recordings.trajectories.size() ? options.recordings.trajectories[i]
                                                   : drones[i].name(),
        options.request.camera_rate_hz));
  }
}

void simulate(Options options) {
  options.request.scenario = *scenario_from_name(options.scenario);
  if (options.request.scenario != Scenario::kMarsYard) {
    if (options.raw16)
      throw std::runtime_error("simulate: --raw16 is for thermal cameras: use it with mars_yard");
    if (options.request.shutter_events)
      throw std::runtime_error("simulate: --shutter is for thermal cameras: use it with mars_yard");
    if (options.request.least_span_k > 0)
      throw std::runtime_error("simulate: --span is for thermal cameras: use it with mars_yard");
  }
  catch_stop_signals();
  StagedFolder folder(options.out, options.force ? is_simulated : nullptr);
  read_sensor_files(options);
  read_recordings(options);
  std::vector<DroneSimulation> drones = make_simulation(options.request);
  require_images(drones, options);

  std::size_t images = 0;
  for (const DroneSimulation& drone : drones) images += drone.image_stamps().size();
  const Clock::time_point start = Clock::now();
  {
    Progress progress(images);
    RenderingCrew crew(drones, folder.path(), options.raw16);
    crew.wait(progress);
  }
  folder.commit();
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - start).count();
  std::printf("%s: %zu drones, %zu images in %.0f s\n", options.out.c_str(), drones.size(), images,
              elapsed_s);
}

}  // namespace

void add_simulate_command(CLI::App& covey) {
  auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand("simulate", "Render a scenario into EuRoC folders");
  command->footer(
      "Example: covey simulate castle_parallel --out data/castle --seed 3\n"
      "         covey simulate room --trajectory MH_04.csv V2_01.csv --seconds 28 --out data/room");
  SimulationRequest& request = options->request;
  command->add_option("scenario", options->scenario, "Where and what the drones fly")
      ->required()
      ->check(CLI::IsMember({"castle_around", "castle_parallel", "mars_yard", "room"}));
  command->add_option("--out", options->out, "Folder to write; must not exist yet")->required();
  command->add_option("--seed", request.seed, "Another number, another world and flight")
      ->check(CLI::Range(std::uint64_t{0}, std::uint64_t{1} << 62U))
      ->capture_default_str();
  command->add_option("--agents", request.agents, "Number of drones (default: the scenario's)")
      ->check(CLI::Range(1, 64));
  command->add_option("--seconds", request.duration_s, "Length (default: the scenario's)")
      ->check(NumberRange(1.0, 3600.0));
  command
      ->add_option("--legs", request.legs,
                   "Fly there and back along the same path, so often one way, each --seconds long: "
                   "hours of flight for the images of one leg")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  command->add_option("--rate", request.camera_rate_hz, "Images per second")
      ->capture_default_str()
      ->check(NumberRange(1.0, 200.0));
  command->add_option(
      "--camera", options->camera,
      "sensor.yaml with the lens and image size of another camera; it is mounted as "
      "the scenario's");
  command->add_option("--imu-noise", options->imu_noise,
                      "sensor.yaml with the noise of another IMU");
  command->add_option("--imu-rate", request.imu_rate_hz, "IMU samples per second (default: 200)")
      ->check(NumberRange(20.0, 4000.0));
  command->add_option("--trajectory", options->recordings.trajectories,
                      "Recorded motion to fly, EuRoC csv, one for each drone (room)");
  command
      ->add_option("--begin", options->recordings.begins_s,
                   "s into the recording at which a drone begins, one for each --trajectory")
      ->check(NumberRange(0.0, 1e5));
  command->add_option("--imu", options->recordings.imus,
                      "Recorded IMU that belongs to it, EuRoC csv, one for each --trajectory");
  command->add_flag("--raw16", options->raw16, "Write 16-bit thermal images as well (cam0raw16)");
  command->add_flag("--shutter", request.shutter_events,
                    "Thermal cameras close their shutter now and then");
  command
      ->add_option("--span", request.least_span_k,
                   "K that thermal cameras spread over their 256 grey levels at least: 40 leaves a "
                   "yard about 4 grey levels of standard deviation")
      ->check(NumberRange(0.5, 500.0));
  command->add_option("--lap", request.lap_m, "Length of each drone's lap in m (mars_yard)")
      ->check(NumberRange(5.0, 100.0));
  command->add_flag("--force", options->force, "Replace a dataset that was simulated");
  command->callback([options] { simulate(*options); });
}

}  // namespace covey
