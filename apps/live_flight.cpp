// SPDX-License-Identifier: Apache-2.0
#include "apps/live_flight.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/agent.h"
#include "apps/camera_pixels.h"
#include "apps/dataset.h"
#include "apps/flight_time.h"
#include "apps/process_usage.h"
#include "apps/sensor_clocks.h"
#include "apps/stop_signal.h"

namespace covey {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPoll{5};  // messages are handled between images as well

// Each kind of trouble is told again after five seconds at the earliest.
class Complaints {
 public:
  void tell(const std::string& kind, const std::string& text) {
    constexpr double kInterval_ms = 5000;
    const double now_ms = steady_ms();
    const auto told = told_ms_.find(kind);
    if (told != told_ms_.end() && now_ms - told->second < kInterval_ms) return;
    told_ms_[kind] = now_ms;
    spdlog::warn("{}", text);
  }

 private:
  std::map<std::string, double> told_ms_;
};

// For how long a count has not grown.
class Silence {
 public:
  void hear(std::uint64_t count) {
    if (count != count_) since_ms_ = steady_ms();
    count_ = count;
  }
  [[nodiscard]] double seconds() const { return 1e-3 * (steady_ms() - since_ms_); }

 private:
  std::uint64_t count_ = 0;
  double since_ms_ = steady_ms();
};

// What camera and IMU say, as far as it can be flown: images of the right size.
class LiveSensors {
 public:
  LiveSensors(const OnboardConfig& config, OnboardLink& link, const CameraIntrinsics& camera)
      : config_(config), link_(link), camera_(camera) {}

  [[nodiscard]] std::optional<CameraImage> next_image() {
    std::optional<CameraImage> image = link_.next_image(kPoll);
    if (!image) return {};
    if (!can_be_flown(*image)) {
      ++unusable_;
      return {};
    }
    warn_of_clocks(clocks_.see_image(image->stamp_ns, steady_ms()));
    return image;
  }

  [[nodiscard]] std::vector<ImuSample> imu() {
    std::vector<ImuSample> samples = link_.take_imu();
    if (!samples.empty()) warn_of_clocks(clocks_.see_imu(samples.back().stamp_ns, steady_ms()));
    return samples;
  }

  // The image that was given out last is of another clock: the IMU will not pass it.
  [[nodiscard]] bool gives_up_waiting() {
    const bool in_vain = clocks_.waits_in_vain(steady_ms());
    if (in_vain) ++unusable_;
    return in_vain;
  }

  // Images that have come and were not flown.
  [[nodiscard]] std::uint64_t dropped() const {
    const OnboardCounts counts = link_.counts();
    return counts.images_dropped + counts.image_stamps.left_out() + unusable_;
  }

  void warn_of_trouble() {
    const OnboardCounts counts = link_.counts();
    camera_silence_.hear(counts.images);
    imu_silence_.hear(counts.imu_samples);
    const std::string where = " has come for 2 s in DDS domain " + std::to_string(config_.domain) +
                              ": does its driver run?";
    if (camera_silence_.seconds() > kSilence_s)
      complaints_.tell("camera", "no image on " + config_.image_topic + where);
    if (imu_silence_.seconds() > kSilence_s)
      complaints_.tell("silent imu", "no sample on " + config_.imu_topic + where);
    warn_of_stamps(config_.image_topic, counts.image_stamps, image_stamps_);
    warn_of_stamps(config_.imu_topic, counts.imu_stamps, imu_stamps_);
    if (counts.imu_dropped > imu_dropped_)
      complaints_.tell("dropped imu", config_.imu_topic +
                                          ": too many samples wait to be flown, the oldest are " +
                                          "dropped: " + so_far(counts.imu_dropped));
    imu_dropped_ = counts.imu_dropped;
    if (counts.refused > refused_) complaints_.tell("refused", counts.last_refusal);
    refused_ = counts.refused;
    if (counts.malformed_packets > malformed_packets_)
      complaints_.tell("packets", "malformed packets come in DDS domain " +
                                      std::to_string(config_.domain) + ", " +
                                      std::to_string(counts.malformed_packets) +
                                      " so far: they are left out");
    malformed_packets_ = counts.malformed_packets;
  }

 private:
  bool can_be_flown(const CameraImage& image) {
    if (image.width != camera_.width || image.height != camera_.height) {
      complaints_.tell("size", config_.image_topic + ": the image is " +
                                   std::to_string(image.width) + "x" +
                                   std::to_string(image.height) + ", sensor.yaml says " +
                                   std::to_string(camera_.width) + "x" +
                                   std::to_string(camera_.height) + ": not flown");
      return false;
    }
    return true;
  }

  void warn_of_stamps(const std::string& topic, const StampCounts& now, StampCounts& told) {
    if (now.late > told.late)
      complaints_.tell("late " + topic, topic + ": its stamps go back: " + so_far(now.late));
    if (now.wrong > told.wrong)
      complaints_.tell("wrong " + topic,
                       topic + ": its stamps jump by more than a second: " + so_far(now.wrong));
    if (now.set_back > told.set_back)
      complaints_.tell("set back " + topic,
                       topic + ": its clock was set back by " + std::to_string(now.set_back_s) +
                           " s: nothing of it is flown until it has caught up, or the agent is " +
                           "started anew; " + so_far(now.set_back));
    told = now;
  }

  static std::string so_far(std::uint64_t left_out) {
    return std::to_string(left_out) + " left out so far";
  }

  void warn_of_clocks(const std::optional<double>& images_ahead_s) {
    if (!images_ahead_s) return;
    complaints_.tell(
        "clocks",
        fmt::format("stamps on {} are {:.1f} s {} those on {}: both must be of one clock, and come "
                    "in time",
                    config_.image_topic, std::abs(*images_ahead_s),
                    *images_ahead_s > 0 ? "ahead of" : "behind", config_.imu_topic));
  }

  static constexpr double kSilence_s = 2;

  const OnboardConfig config_;
  OnboardLink& link_;
  const CameraIntrinsics camera_;
  Complaints complaints_;
  Silence camera_silence_, imu_silence_;
  SensorClocks clocks_;
  StampCounts image_stamps_, imu_stamps_;  // that were told
  std::uint64_t imu_dropped_ = 0, refused_ = 0, malformed_packets_ = 0, unusable_ = 0;
};

// The world that all drones share, or this one's.
std::string world_name(const AgentConfig& config) {
  return config.initialisation.own_world ? config.agent.name + "/world" : "world";
}

// Who waits for it is there for its peers, and says so in its folder. Nothing if stopped, or if
// agent.duration_s is over; however short that is, drivers have a while to come up.
std::optional<CameraImage> first_image(Agent& agent, LiveSensors& sensors) {
  constexpr double kDriversComeUp_s = 10;
  const double duration_s = agent.config().agent.duration_s, begun_ms = steady_ms();
  const auto is_over = [&] {
    const double waited_s = (steady_ms() - begun_ms) * 1e-3;
    return duration_s > 0 && waited_s > std::max(duration_s, kDriversComeUp_s);
  };
  std::optional<CameraImage> image;
  while (!image && !stop_requested() && !is_over()) {
    image = sensors.next_image();
    agent.take_inbox();
    agent.handle_messages();
    agent.show_status();
    sensors.warn_of_trouble();
  }
  return image;
}

// Who stands on the ground and does not start wants to know why.
void warn_of_wait(const Agent& agent, double waited_s, Complaints& complaints) {
  constexpr double kPatience_s = 2;
  const auto reason = agent.not_started();
  if (reason && waited_s > kPatience_s) complaints.tell("start", "does not start yet: " + *reason);
}

// Each image as soon as the IMU has passed it. False: stopped before agent.duration_s was over.
bool fly_until_stopped(Agent& agent, OnboardLink& link, LiveSensors& sensors,
                       std::optional<CameraImage> image) {
  FlightTime time(agent.config().agent.duration_s, image->stamp_ns, steady_ms());
  Complaints complaints;
  while (!stop_requested()) {
    if (!image) {
      image = sensors.next_image();
      if (image) time.see_image(image->stamp_ns, steady_ms());
    }
    if (time.is_over(steady_ms())) return true;
    const bool covered = image && link.wait_for_imu(agent.imu_moment(image->stamp_ns), kPoll);
    agent.add_imu(sensors.imu());
    agent.take_inbox();
    agent.handle_messages();
    agent.set_dropped(sensors.dropped());
    if (covered) {
      agent.fly(image->stamp_ns, pixels_of(*image).clone(), 0);  // a thermal one is kept
      warn_of_wait(agent, time.flown_s(), complaints);
      image.reset();
    } else if (image && sensors.gives_up_waiting()) {
      image.reset();  // the next one takes its place
    }
    sensors.warn_of_trouble();
    agent.show_status();
  }
  return agent.config().agent.duration_s == 0;
}

// Nobody else does. Who is stopped on the ground need not have started.
void tell_of_start(const AgentSummary& summary, bool stopped) {
  if (!summary.not_started) return;
  const std::string why =
      "did not start: " +
      (summary.frames > 0 ? *summary.not_started : "no image has come that the IMU has passed");
  if (!stopped) throw std::runtime_error(why);
  spdlog::warn("{}", why);
}

}  // namespace

bool run_live_agent(const AgentConfig& config) {
  require_possible(config);
  Dataset description = read_sensors(config.agent.dataset);
  const OnboardConfig onboard = onboard_config(config);
  OnboardLink link(onboard, world_name(config), config.agent.name + "/imu");
  LiveSensors sensors(onboard, link, description.camera);
  for (const std::string& warning : description.warnings) spdlog::warn("{}", warning);
  std::optional<Agent> agent(std::in_place, config, description, link);
  spdlog::info("listens to {} and {} in DDS domain {}", onboard.image_topic, onboard.imu_topic,
               onboard.domain);
  std::optional<CameraImage> image = first_image(*agent, sensors);
  if (!image) {
    const std::string why =
        (stop_requested() ? "stopped before an image came on "
                          : "agent.duration_s was over before an image came on ") +
        onboard.image_topic;
    agent->finish(why);
    throw std::runtime_error(why);
  }
  if (image->bytes_per_pixel == 2 && !description.thermal) {
    agent.reset();  // its images say what its sensor.yaml does not: it begins again
    description.thermal = true;
    agent.emplace(config, description, link);
  }
  const bool complete = fly_until_stopped(*agent, link, sensors, std::move(image));
  agent->set_dropped(sensors.dropped());
  const AgentSummary summary =
      agent->finish(complete ? std::nullopt : std::optional<std::string>("was stopped"));
  tell_of_start(summary, stop_requested());
  return complete;
}

}  // namespace covey
