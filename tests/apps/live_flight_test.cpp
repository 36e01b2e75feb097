// SPDX-License-Identifier: Apache-2.0
//
// A drone's process that hears its camera and IMU over DDS, from a recording that is played.
#include "apps/live_flight.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "apps/agent.h"
#include "apps/config_file.h"
#include "apps/dataset.h"
#include "apps/free_domain.h"
#include "apps/json_file.h"
#include "apps/run_files.h"
#include "comms/onboard_participant.h"
#include "comms/onboard_topics.h"
#include "comms/sensor_player.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/eventually.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

constexpr double kAllButTheLastImage_s = 2.9;
constexpr TimeNs kSample_ns = 5'000'000;  // of the IMU
using nlohmann::json;
using testing::HasSubstr;

class LiveFlight : public testing::Test {
 protected:
  void SetUp() override {
    fs::copy(fs::path(COVEY_TEST_FLIGHT) / "uav0" / "mav0", mav0_, fs::copy_options::recursive);
    // Nobody knows where a live flight starts.
    fs::remove_all(mav0_ / "state_groundtruth_estimate0");
  }

  // Every image, however slow this machine is.
  [[nodiscard]] json settings(const std::string& pace) const {
    return {{"agent",
             {{"name", "uav0"},
              {"mode", "solo"},
              {"pace", pace},
              {"image_queue", 1000},
              {"dataset", mav0_},
              {"out", (folder_.path() / pace).string()}}},
            {"initialisation", {{"method", "static"}}},
            {"onboard", {{"domain", domain_.id()}, {"reliable", true}}}};
  }

  [[nodiscard]] std::string config_file(const json& settings) const {
    const fs::path file = folder_.path() / "config.json";
    write_json_file(file, settings);
    return file;
  }

  [[nodiscard]] std::vector<std::string> play(const std::string& config) const {
    return {"play", mav0_, "--config", config, "--rate", "4"};
  }

  // The IMU goes on.
  void keep_images(int images) const {
    const fs::path list = mav0_ / "cam0" / "data.csv";
    std::istringstream all(file_content(list));
    std::ofstream kept(list);
    std::string line;
    for (int i = 0; i <= images && std::getline(all, line); ++i) kept << line << '\n';
  }

  [[nodiscard]] json summary(const std::string& pace) const {
    return read_json_file(folder_.path() / pace / kAgentSummaryFile);
  }

  [[nodiscard]] std::string trajectory(const std::string& pace) const {
    return file_content(folder_.path() / pace / kTrajectoryFile);
  }

  TemporaryFolder folder_;
  const fs::path mav0_ = folder_.path() / "mav0";
  const FreeDomain domain_;
};

TEST_F(LiveFlight, FliesAsTheRecordingOfItDoesUntilItsTimeIsOver) {
  for (const std::string pace : {"max", "live"}) {
    json wanted = settings(pace);
    wanted["agent"]["duration_s"] = kAllButTheLastImage_s;
    const std::string config = config_file(wanted);
    CoveyProcess drone({"agent", "--config", config});
    if (pace == "live") {
      CoveyProcess player(play(config));
      EXPECT_EQ(player.finish(), 0) << player.output();
      EXPECT_THAT(player.output(), HasSubstr("played 45 images"));
    }
    ASSERT_EQ(drone.finish(), 0) << drone.output();
    EXPECT_EQ(summary(pace)["frames"], COVEY_TEST_FLIGHT_FRAMES - 1);
    EXPECT_EQ(summary(pace)["frames_dropped"], 0);
  }
  EXPECT_GT(trajectory("max").size(), 1000U);
  EXPECT_EQ(trajectory("live"), trajectory("max"));
}

// Of a message that begins with a header of ROS 2, after the four bytes that say how it is encoded.
TimeNs stamp_of(const Bytes& message) {
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
  std::memcpy(&sec, &message.at(4), sizeof sec);
  std::memcpy(&nanosec, &message.at(8), sizeof nanosec);
  return sec * nanoseconds(1) + static_cast<TimeNs>(nanosec);
}

// At half the IMU's rate, sample by sample in this process.
TEST_F(LiveFlight, TellsItsMotionBetweenImagesAsWell) {
  json wanted = settings("live");
  wanted["onboard"]["odometry_rate_hz"] = 100;
  const AgentConfig config = read_config(config_file(wanted));
  std::mutex mutex;
  std::vector<TimeNs> stamps;
  const auto newest = [&] {
    const std::lock_guard lock(mutex);
    return stamps.empty() ? TimeNs{0} : stamps.back();
  };
  // Best effort: within one process Fast DDS loses none, but a reliable reader waits for what the
  // writer sent before the reader knew it, until 256 more have come.
  OnboardParticipant listener({domain_.id(), true});
  listener.read(
      nav_odometry_topic("odometry"), false,
      [&](const Bytes& message) {
        const std::lock_guard lock(mutex);
        stamps.push_back(stamp_of(message));
      },
      [](const std::string& policy) { ADD_FAILURE() << policy; });
  OnboardLink link(config.onboard, "world", "imu");
  BodyMotion first;
  first.odometry.stamp_ns = 1;
  ASSERT_TRUE(eventually([&] {
    link.publish(first);
    return newest() != 0;
  }));

  const Dataset recording = read_dataset(mav0_);
  Agent agent(config, read_sensors(mav0_), link);
  std::size_t next = 0;
  for (const ImageEntry& image : recording.images) {
    while (recording.imu[next].stamp_ns <= agent.imu_moment(image.stamp_ns) + kSample_ns)
      agent.add_imu({recording.imu[next++]});
    agent.fly(image.stamp_ns, read_image(image, agent.camera().width, agent.camera().height), 0);
  }
  const TimeNs last = recording.imu[next - 1].stamp_ns - kSample_ns;
  ASSERT_TRUE(eventually([&] { return newest() >= last; }));
  const std::lock_guard lock(mutex);
  stamps.erase(stamps.begin(), std::upper_bound(stamps.begin(), stamps.end(), TimeNs{1}));
  EXPECT_LT(stamps.front(), recording.images.front().stamp_ns + nanoseconds(1)) << "it has started";
  for (std::size_t i = 1; i < stamps.size(); ++i)
    EXPECT_EQ(stamps[i] - stamps[i - 1], 2 * kSample_ns) << i;
}

TEST_F(LiveFlight, EndsInGoodOrderWhenItIsStopped) {
  const std::string config = config_file(settings("live"));
  CoveyProcess drone({"agent", "--config", config});
  CoveyProcess player(play(config));
  ASSERT_EQ(player.finish(), 0) << player.output();
  drone.send(SIGTERM);
  EXPECT_EQ(drone.finish(), 0) << drone.output();
  EXPECT_GT(summary("live")["frames"], 0);
  EXPECT_FALSE(summary("live").contains("incomplete"));
}

TEST_F(LiveFlight, EndsInTimeThoughItsCameraHasGoneSilent) {
  json wanted = settings("live");
  wanted["agent"]["duration_s"] = 1.5;
  const std::string config = config_file(wanted);
  keep_images(12);
  CoveyProcess drone({"agent", "--config", config});
  CoveyProcess player(play(config));
  ASSERT_EQ(player.finish(), 0) << player.output();
  EXPECT_EQ(drone.finish(), 0) << drone.output();
  EXPECT_EQ(summary("live")["frames"], 12);
}

TEST_F(LiveFlight, EndsInTimeThoughItsImuIsSilent) {
  json wanted = settings("live");
  wanted["agent"]["duration_s"] = 1;
  const std::string config = config_file(wanted);
  CoveyProcess drone({"agent", "--config", config});
  ASSERT_TRUE(drone.wait_for("listens to")) << drone.output();
  SensorPlayer player(read_config(config).onboard);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  CameraImage image{nanoseconds(1), 752, 480, 1, std::vector<std::uint8_t>(std::size_t{752} * 480)};
  for (int i = 0; i < 4; ++i) {
    player.play(image);
    image.stamp_ns += nanoseconds(0.05);
  }
  EXPECT_EQ(drone.finish(), 1);
  EXPECT_THAT(drone.output(),
              HasSubstr("did not start: no image has come that the IMU has passed"));
}

TEST_F(LiveFlight, SaysThatItWasStoppedBeforeItsTimeWasOver) {
  json wanted = settings("live");
  wanted["agent"]["duration_s"] = 1000;
  const std::string config = config_file(wanted);
  CoveyProcess drone({"agent", "--config", config});
  CoveyProcess player(play(config));
  ASSERT_EQ(player.finish(), 0) << player.output();
  drone.send(SIGTERM);
  EXPECT_EQ(drone.finish(), 1) << drone.output();
  EXPECT_EQ(summary("live")["incomplete"], "was stopped");
}

TEST_F(LiveFlight, SaysThatItDidNotStartUntilItsTimeWasOver) {
  json wanted = settings("live");
  wanted["agent"]["duration_s"] = 0.3;  // a static start takes longer
  const std::string config = config_file(wanted);
  CoveyProcess drone({"agent", "--config", config});
  CoveyProcess player(play(config));
  ASSERT_EQ(player.finish(), 0) << player.output();
  EXPECT_EQ(drone.finish(), 1) << drone.output();
  EXPECT_THAT(drone.output(), HasSubstr("uav0: did not start: "));
  EXPECT_GT(summary("live")["frames"], 0);
}

// In real time, as the radio wants it.
TEST_F(LiveFlight, TwoInTheAirAskEachOther) {
  const FreeDomain radio;
  std::vector<std::string> configs;
  for (const std::string name : {"uav0", "uav1"}) {
    json wanted = settings("live");
    wanted["agent"]["name"] = name;
    wanted["agent"]["mode"] = "collaborative";
    wanted["agent"]["duration_s"] = kAllButTheLastImage_s;
    wanted["agent"]["dataset"] = fs::path(COVEY_TEST_FLIGHT) / name / "mav0";
    wanted["agent"]["out"] = (folder_.path() / name).string();
    wanted["onboard"]["image_topic"] = name + "/camera/image_raw";
    wanted["onboard"]["imu_topic"] = name + "/imu/data_raw";
    wanted["link"] = {{"domain", radio.id()}};
    configs.push_back(folder_.path() / (name + ".json"));
    write_json_file(configs.back(), wanted);
  }
  CoveyProcess first({"agent", "--config", configs[0]}), second({"agent", "--config", configs[1]});
  const std::string flight = COVEY_TEST_FLIGHT;
  CoveyProcess first_sensors({"play", flight + "/uav0/mav0", "--config", configs[0]});
  CoveyProcess second_sensors({"play", flight + "/uav1/mav0", "--config", configs[1]});
  EXPECT_EQ(first_sensors.finish(), 0) << first_sensors.output();
  EXPECT_EQ(second_sensors.finish(), 0) << second_sensors.output();
  EXPECT_EQ(first.finish(), 0) << first.output();
  EXPECT_EQ(second.finish(), 0) << second.output();
  for (const std::string drone : {"uav0", "uav1"}) {
    const json told = summary(drone);
    EXPECT_EQ(told["frames"], COVEY_TEST_FLIGHT_FRAMES - 1);
    EXPECT_GT(told["link"]["request"]["received"], 0) << drone;
  }
}

TEST_F(LiveFlight, SaysWhatIsSilentAndIsStoppedBeforeItsFirstImage) {
  const std::string config = config_file(settings("live"));
  CoveyProcess drone({"agent", "--config", config});
  ASSERT_TRUE(drone.wait_for("no image on camera/image_raw has come for 2 s")) << drone.output();
  ASSERT_TRUE(drone.wait_for("no sample on imu/data_raw has come for 2 s")) << drone.output();
  CoveyProcess asked({"agent", "--is-flying", "--out", folder_.path() / "live"});
  EXPECT_EQ(asked.finish(), 0) << "who waits is well";
  drone.send(SIGTERM);
  EXPECT_EQ(drone.finish(), 1);
  EXPECT_THAT(summary("live")["incomplete"].get<std::string>(), HasSubstr("before an image came"));
  EXPECT_THAT(drone.output(), HasSubstr("stopped before an image came on camera/image_raw"));
}

TEST_F(LiveFlight, FailsWhenItsTimeIsOverBeforeAnImageComes) {
  json wanted = settings("live");
  wanted["agent"]["duration_s"] = 1;  // ten are waited
  CoveyProcess drone({"agent", "--config", config_file(wanted)});
  EXPECT_EQ(drone.finish(), 1);
  EXPECT_THAT(drone.output(),
              HasSubstr("agent.duration_s was over before an image came on camera"));
  EXPECT_THAT(summary("live")["incomplete"].get<std::string>(), HasSubstr("before an image came"));
}

TEST_F(LiveFlight, WhatIsWrongWithItsSettingsIsSaidBeforeAnyImageComes) {
  json wanted = settings("live");
  wanted["agent"]["mode"] = "collaborative";
  wanted["link"] = {{"loopback_only", false}, {"interfaces", {"192.0.2.77"}}};
  CoveyProcess drone({"agent", "--config", config_file(wanted)});
  EXPECT_EQ(drone.finish(), 1);
  EXPECT_THAT(drone.output(), HasSubstr("192.0.2.77"));
}

TEST_F(LiveFlight, SamplesThatAreDroppedWhileNoImageComesAreTold) {
  const std::string config = config_file(settings("live"));
  CoveyProcess drone({"agent", "--config", config});
  ASSERT_TRUE(drone.wait_for("listens to")) << drone.output();
  const OnboardConfig onboard = read_config(config).onboard;
  SensorPlayer player(onboard);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  const auto more = static_cast<TimeNs>(onboard.imu_queue) + 100;
  for (TimeNs i = 0; i < more; ++i)
    player.play(ImuSample{nanoseconds(1) + i * 1'000'000, {0, 0, 0}, {0, 0, 9.81}});
  EXPECT_TRUE(drone.wait_for("imu/data_raw: too many samples wait to be flown")) << drone.output();
}

// Its sensor.yaml does not say that the camera is a thermal one.
TEST_F(LiveFlight, ImagesOf16BitsAreFlownAsAThermalCameras) {
  const OnboardConfig onboard = read_config(config_file(settings("live"))).onboard;
  const std::string config = config_file(settings("live"));
  CoveyProcess drone({"agent", "--config", config});
  ASSERT_TRUE(drone.wait_for("listens to")) << drone.output();
  SensorPlayer player(onboard);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  CameraImage image{nanoseconds(1), 752, 480, 2,
                    std::vector<std::uint8_t>(std::size_t{2} * 752 * 480)};
  for (int i = 0; i < 4; ++i) {  // three in a row are believed
    player.play(ImuSample{image.stamp_ns - kSample_ns, {0, 0, 0}, {0, 0, 9.81}});
    player.play(image);
    image.stamp_ns += nanoseconds(0.05);
  }
  const fs::path thermal = folder_.path() / "live" / kThermalFile;
  EXPECT_TRUE(eventually([&] { return fs::exists(thermal); }));
  drone.send(SIGTERM);
  EXPECT_EQ(drone.finish(), 0) << drone.output();
}

TEST_F(LiveFlight, ImagesOfAnotherSizeAreNotFlown) {
  const std::string config = config_file(settings("live"));
  const fs::path yaml = mav0_ / "cam0" / "sensor.yaml";
  const fs::path small = folder_.path() / "small";
  fs::copy(mav0_, small, fs::copy_options::recursive);
  std::string text = file_content(yaml);
  text.replace(text.find("752"), 3, "640");
  std::ofstream(yaml) << text;
  CoveyProcess drone({"agent", "--config", config});
  ASSERT_TRUE(drone.wait_for("listens to")) << drone.output();
  CoveyProcess player({"play", small, "--config", config, "--rate", "20"});
  EXPECT_TRUE(drone.wait_for("the image is 752x480, sensor.yaml says 640x480: not flown"))
      << drone.output();
}

// What a drone that lies still hears; its clocks are this test's.
class StillDrone {
 public:
  explicit StillDrone(const OnboardConfig& onboard) : player_(onboard) {
    if (!eventually([&] { return player_.is_heard(); })) throw std::runtime_error("nobody listens");
  }

  void play(TimeNs imu_ns, TimeNs image_ns) {
    image_.stamp_ns = image_ns;
    player_.play(ImuSample{imu_ns, {0, 0, 0}, {0, 0, 9.81}});
    player_.play(image_);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }

 private:
  SensorPlayer player_;
  CameraImage image_{0, 752, 480, 1, std::vector<std::uint8_t>(std::size_t{752} * 480)};
};

TEST_F(LiveFlight, SensorsOfTwoClocksAreTold) {
  const std::string config = config_file(settings("live"));
  for (const auto& [images_ahead_s, words] :
       {std::pair{-1000.0, "1000.0 s behind those on imu/data_raw: both must be of one clock"},
        std::pair{1000.0, "1000.0 s ahead of those on imu/data_raw: both must be of one clock"}}) {
    CoveyProcess drone({"agent", "--config", config});
    ASSERT_TRUE(drone.wait_for("listens to")) << drone.output();
    StillDrone sensors(read_config(config).onboard);
    std::atomic<bool> told = false;
    std::thread drivers([&, ahead_ns = nanoseconds(images_ahead_s)] {
      for (TimeNs now_ns = nanoseconds(1e6); !told; now_ns += nanoseconds(0.01))
        sensors.play(now_ns, now_ns + ahead_ns);
    });
    EXPECT_TRUE(drone.wait_for(words)) << drone.output();
    told = true;
    drivers.join();
  }
}

// The first image waits for an IMU of another clock in vain: no flight begins so long ago.
TEST_F(LiveFlight, WhoseImuClockIsPutRightFliesOnlyNewImages) {
  json wanted = settings("live");
  wanted["agent"]["duration_s"] = 4;
  wanted["agent"]["image_queue"] = 4;
  const std::string config = config_file(wanted);
  CoveyProcess drone({"agent", "--config", config});
  ASSERT_TRUE(drone.wait_for("listens to")) << drone.output();
  StillDrone sensors(read_config(config).onboard);
  std::atomic<bool> ended = false;
  const TimeNs begin_ns = nanoseconds(1e6);
  std::thread drivers([&] {
    for (TimeNs now_ns = begin_ns; !ended; now_ns += nanoseconds(0.01)) {
      const bool put_right = now_ns > begin_ns + nanoseconds(2);
      sensors.play(put_right ? now_ns : now_ns - nanoseconds(1000), now_ns);
    }
  });
  (void)drone.finish();
  ended = true;
  drivers.join();
  const auto flown = read_timings(folder_.path() / "live" / kTimingsFile);
  ASSERT_FALSE(flown.empty()) << drone.output();
  EXPECT_GT(flown.front().stamp_ns, begin_ns + nanoseconds(0.5)) << drone.output();
}

TEST_F(LiveFlight, AStartFromGroundTruthIsRefused) {
  json wanted = settings("live");
  wanted["initialisation"]["method"] = "groundtruth";
  CoveyProcess drone({"agent", "--config", config_file(wanted)});
  EXPECT_EQ(drone.finish(), 1);
  EXPECT_THAT(drone.output(), HasSubstr("set initialisation.method to static"));
}

TEST_F(LiveFlight, NobodyIsPlayedToForEver) {
  CoveyProcess player({"play", mav0_, "--config", config_file(settings("live")), "--wait", "0"});
  EXPECT_EQ(player.finish(), 1);
  EXPECT_THAT(player.output(), HasSubstr("nobody listens to camera/image_raw and imu/data_raw"));
}

}  // namespace
}  // namespace covey
