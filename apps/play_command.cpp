// SPDX-License-Identifier: Apache-2.0
#include "apps/play_command.h"

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "apps/camera_pixels.h"
#include "apps/config_file.h"
#include "apps/dataset.h"
#include "apps/image_reader.h"
#include "apps/number_range.h"
#include "apps/progress.h"
#include "apps/stop_signal.h"
#include "comms/sensor_player.h"

namespace covey {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

struct Options {
  std::string mav0, config_file;
  double rate = 1, wait_s = 30;
};

// False: nobody has come, or stopped.
bool wait_for_listener(const SensorPlayer& player, double patience_s) {
  constexpr milliseconds kPoll{20};
  const auto deadline = Clock::now() + std::chrono::duration<double>(patience_s);
  while (!player.is_heard() && !stop_requested() && Clock::now() < deadline)
    std::this_thread::sleep_for(kPoll);
  return player.is_heard();
}

// When what was recorded at `stamp_ns` is due.
class PlayClock {
 public:
  PlayClock(TimeNs first_ns, double rate) : first_ns_(first_ns), rate_(rate) {}
  void wait_for(TimeNs stamp_ns) const {
    std::this_thread::sleep_until(
        start_ + std::chrono::duration_cast<Clock::duration>(
                     std::chrono::duration<double>(seconds_between(first_ns_, stamp_ns) / rate_)));
  }

 private:
  TimeNs first_ns_;
  double rate_;
  Clock::time_point start_ = Clock::now();
};

void play(const Dataset& recording, const OnboardConfig& onboard, const Options& options) {
  SensorPlayer player(onboard);
  if (!wait_for_listener(player, options.wait_s)) {
    if (stop_requested()) return;
    throw std::runtime_error("nobody listens to " + onboard.image_topic + " and " +
                             onboard.imu_topic + " in DDS domain " +
                             std::to_string(onboard.domain) + ": start covey agent first");
  }
  const PlayClock clock(std::min(recording.imu.front().stamp_ns, recording.images.front().stamp_ns),
                        options.rate);
  ImageReader reader(recording.camera);
  Progress progress(recording.images.size());
  std::size_t played = 0, refused = 0, next_imu = 0;
  const auto play_imu_until = [&](TimeNs stamp_ns) {
    while (next_imu < recording.imu.size() && recording.imu[next_imu].stamp_ns <= stamp_ns) {
      clock.wait_for(recording.imu[next_imu].stamp_ns);
      if (!player.play(recording.imu[next_imu++])) ++refused;
    }
  };
  for (const ImageEntry& entry : recording.images) {
    if (stop_requested()) break;
    const std::optional<cv::Mat> pixels = reader.read(entry);
    play_imu_until(entry.stamp_ns);
    if (!pixels) continue;
    const CameraImage image = to_camera_image(entry.stamp_ns, *pixels);
    clock.wait_for(entry.stamp_ns);
    if (!player.play(image)) ++refused;
    progress.show(++played);
  }
  // The last image is flown once the IMU has passed it.
  constexpr double kBeyondLastImage_s = 0.5;
  if (!stop_requested())
    play_imu_until(recording.images.back().stamp_ns + nanoseconds(kBeyondLastImage_s));
  constexpr milliseconds kFarewell{5000};
  (void)player.wait_until_received(kFarewell);
  std::printf("played %zu images and %zu IMU samples\n", played, next_imu);
  if (refused > 0) spdlog::warn("{} of them nobody took in time", refused);
  if (reader.left_out() > 0) spdlog::warn("{} images were left out", reader.left_out());
}

void run(const Options& options) {
  AgentConfig config;
  if (!options.config_file.empty()) config = read_config(options.config_file);
  catch_stop_signals();
  play(read_recording(options.mav0), config.onboard, options);
}

}  // namespace

void add_play_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand(
      "play", "Says what a recording's camera and IMU said, as their drivers would over DDS");
  command->footer(
      "Example: covey agent --config live.json &      \"agent\": { \"pace\": \"live\", ... },\n"
      "                                               \"initialisation\": { \"method\": \"static\" "
      "}\n"
      "         covey play data/castle/uav0/mav0 --config live.json");
  command->add_option("mav0", options->mav0, "Folder that holds cam0 and imu0")->required();
  command
      ->add_option("--config", options->config_file, "Of the drone that listens: section onboard")
      ->type_name("FILE.json");
  command->add_option("--rate", options->rate, "Times real time")
      ->capture_default_str()
      ->check(NumberRange(0.01, 100.0));
  command->add_option("--wait", options->wait_s, "s to wait for somebody who listens")
      ->capture_default_str()
      ->check(NumberRange(0.0, 3600.0));
  command->callback([options] { run(*options); });
}

}  // namespace covey
