// SPDX-License-Identifier: Apache-2.0
//
// A drone and the process of its link, which dies, hangs, grows and lies here. A link's process is
// this very program: the true one, or one that misbehaves, by the drone's name.
#include "apps/link_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/if_tun.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <csignal>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "apps/child_process.h"
#include "apps/drone_network.h"
#include "apps/link_worker.h"
#include "apps/process_usage.h"
#include "apps/stop_signal.h"
#include "comms/own_addresses.h"
#include "comms/peer_link.h"
#include "tests/apps/covey_process.h"
#include "tests/comms/eventually.h"
#include "tests/comms/samples.h"
#include "tests/comms/taken_port.h"
#include "tests/comms/team_config.h"

namespace covey {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Key;

// ------------------------------------------------------------------------- processes that
// misbehave

// Reports like a true one, and does something else in between.
void report_and(int socket, const std::function<void(RecordChannel&)>& misbehave) {
  RecordChannel channel(socket);
  while (channel.exchange(milliseconds(5))) {
    channel.offer(RecordKind::kReport, encode(LinkReport()));
    misbehave(channel);
  }
}

void grow(int socket) {
  std::vector<Bytes> hoard;
  report_and(socket, [&](RecordChannel&) { hoard.emplace_back(8 << 20, std::uint8_t{1}); });
}

void fall_silent(int socket) {
  report_and(socket, [](RecordChannel& channel) {
    (void)channel.exchange(milliseconds(0));
    pause();
  });
}

void babble(int socket) {
  report_and(socket, [socket](RecordChannel& channel) {
    (void)channel.exchange(milliseconds(0));
    (void)send(socket, "no record at all", 16, MSG_NOSIGNAL);
  });
}

void report_nonsense(int socket) {
  report_and(socket, [](RecordChannel& channel) {
    channel.offer(RecordKind::kReport, to_bytes(R"({"peers": -1})"));
  });
}

void slander(int socket) {
  report_and(socket, [](RecordChannel& channel) {
    channel.offer(RecordKind::kRequest, to_bytes("not a sample"));
    channel.offer(RecordKind::kStatus, encode(StatusSample{samples::status("slander"), {}}));
    channel.offer(RecordKind::kRequest, encode(samples::advert("uav7")));
  });
}

void give_up(int socket) {
  RecordChannel channel(socket);
  channel.offer(RecordKind::kComplaint, to_bytes("link: no such radio\x1b"));
  channel.finish(milliseconds(1000));
}

int play_link(const std::string& drone, int socket) {
  if (drone == "grow") grow(socket);
  if (drone == "fall_silent") fall_silent(socket);
  if (drone == "babble") babble(socket);
  if (drone == "report_nonsense") report_nonsense(socket);
  if (drone == "slander") slander(socket);
  if (drone == "give_up") give_up(socket);
  if (drone == "wait") pause();
  if (drone == "leave") return 3;
  return drone.rfind("uav", 0) == 0 && !run_link(socket) ? 1 : 0;
}

// ----------------------------------------------------------------------------------------- helpers

AgentConfig drone(const std::string& name) {
  AgentConfig config;
  config.agent.name = name;
  config.link = team_config(name);
  config.link.max_memory_mib = 1024;  // sanitizers need much
  return config;
}

std::optional<pid_t> process_of(const std::string& drone) {
  for (const pid_t child : children_of(getpid()))
    if (file_content("/proc/" + std::to_string(child) + "/cmdline").find(drone) !=
        std::string::npos)
      return child;
  return std::nullopt;
}

std::uint64_t restarts(const Link& link) {
  std::uint64_t count = 0;
  for (const auto& [reason, times] : link.statistics().restarts) count += times;
  return count;
}

// Asks again and again, as a flight does, until it is heard.
bool reaches(Link& from, const std::string& sender, Link& to) {
  (void)to.take();
  static std::uint64_t keyframe_id = 1000;
  const std::uint64_t first = ++keyframe_id;
  return eventually([&] {
    (void)from.send(samples::advert(sender, ++keyframe_id));
    for (const Inbound& inbound : to.take()) {
      const auto* advert = std::get_if<PlaceAdvert>(&inbound);
      if (advert != nullptr && advert->keyframe_id > first) return true;
    }
    return false;
  });
}

// The reason for which the process of a drone with this name is started anew again and again.
std::string end_of(const std::string& name) {
  const LinkProcess link(drone(name));
  EXPECT_TRUE(eventually([&] { return restarts(link) >= 2; }));
  return link.statistics().restarts.begin()->first;
}

std::string complaint(const AgentConfig& config) {
  try {
    const LinkProcess link(config);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

bool has_carrier(const std::string& address) {
  for (const OwnAddress& own : own_addresses())
    if (own.address == address) return own.running;
  return false;
}

// Two computers on a network. The radio of the first has no carrier until it is given one.
class Radio {
 public:
  // On a thread of its own: its namespace is the thread's.
  static void fly(const std::function<void(const Radio&)>& flight) {
    std::vector<DroneNamespace> computers;
    for (std::size_t i = 0; i < 2; ++i) computers.push_back(make_drone_namespace(i, 2));
    const Radio radio(std::move(computers));
    std::thread([&] {
      radio.go_to(0);
      radio.set_carrier(0);
      flight(radio);
    }).join();
  }

  // What this thread starts from now on is on that computer.
  void go_to(std::size_t computer) const {
    ASSERT_EQ(setns(networks_[computer].get(), CLONE_NEWNET), 0);
  }

  void give_carrier() const { set_carrier(1); }

 private:
  explicit Radio(std::vector<DroneNamespace> computers) : tap_(dup(computers[0].tap.get())) {
    std::vector<FileDescriptor> taps;
    for (DroneNamespace& each : computers) {
      networks_.push_back(std::move(each.network));
      taps.push_back(std::move(each.tap));
    }
    NetworkModel model;
    model.drones = networks_.size();
    switch_ = std::make_unique<FrameSwitch>(std::move(taps), LinkModel(model, 1));
  }

  // On the first computer.
  void set_carrier(int on) const {
    ASSERT_EQ(ioctl(tap_.get(), TUNSETCARRIER, &on), 0);
    ASSERT_TRUE(eventually([on] { return has_carrier(drone_address(0)) == (on != 0); }));
  }

  const FileDescriptor tap_;
  std::vector<FileDescriptor> networks_;
  std::unique_ptr<FrameSwitch> switch_;
};

LinkConfig on_radio(LinkConfig config, std::size_t computer) {
  config.loopback_only = false;
  config.interfaces = {drone_address(computer)};
  config.initial_peers = {drone_address(0), drone_address(1)};
  return config;
}

LinkConfig on_all_interfaces(LinkConfig config) {
  config = on_radio(std::move(config), 0);
  config.interfaces.clear();
  return config;
}

class LinkNetworkComes : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_namespaces()) GTEST_SKIP() << *why;
  }
};

TEST_F(LinkNetworkComes, ARadioWithoutCarrierIsWaitedForAndThenUsed) {
  Radio::fly([](const Radio& radio) {
    AgentConfig config = drone("uav0");
    config.link = on_radio(config.link, 0);
    LinkProcess link(config);
    EXPECT_EQ(link.statistics().missing_network, "link.interfaces \"10.77.0.1\" has no carrier");
    EXPECT_EQ(link.statistics().unseen_port, 0U) << "no port was taken";
    (void)link.send(samples::advert("uav0"));
    ASSERT_TRUE(eventually([&] { return link.statistics().request.refused == 1; }));
    radio.give_carrier();
    radio.go_to(1);
    PeerLink peer(on_radio(team_config("uav1"), 1));
    EXPECT_TRUE(reaches(link, "uav0", peer) && reaches(peer, "uav1", link));
    EXPECT_TRUE(eventually([&] { return link.statistics().missing_network.empty(); }));
  });
}

TEST_F(LinkNetworkComes, WhoUsesAllInterfacesUsesOneThatComesLater) {
  Radio::fly([](const Radio& radio) {
    AgentConfig config = drone("uav0");
    config.link = on_all_interfaces(config.link);
    LinkProcess link(config);
    EXPECT_EQ(link.statistics().missing_network, "no interface has an address and a carrier");
    radio.give_carrier();
    radio.go_to(1);
    PeerLink peer(on_radio(team_config("uav1"), 1));
    EXPECT_TRUE(reaches(link, "uav0", peer) && reaches(peer, "uav1", link));
    EXPECT_THAT(link.statistics().restarts, Contains(Key(kAddressesCame)));
    EXPECT_TRUE(eventually([&] { return link.statistics().missing_network.empty(); }));
  });
}

TEST_F(LinkNetworkComes, ALinkOfThisProcessSaysThatThereIsNoCarrier) {
  Radio::fly([](const Radio& /*radio*/) {
    EXPECT_THAT([] { PeerLink(on_radio(team_config("uav0"), 0)); },
                testing::ThrowsMessage<std::runtime_error>(HasSubstr("has no carrier")));
  });
}

TEST_F(LinkNetworkComes, AnAddressThatNoInterfaceHasIsRefusedAtTheStart) {
  Radio::fly([](const Radio& /*radio*/) {
    AgentConfig config = drone("uav0");
    config.link = on_radio(config.link, 0);
    config.link.interfaces = {drone_address(7)};
    EXPECT_THAT(complaint(config), HasSubstr("\"10.77.0.8\" is no address of this machine"));
  });
}

class LinkProcessEnds : public testing::TestWithParam<int> {};

// Killed, or stopped: then it hangs.
TEST_P(LinkProcessEnds, AnotherOneIsThereAndTalksWithinSeconds) {
  LinkProcess link(drone("uav0"));
  PeerLink peer(team_config("uav1"));
  ASSERT_TRUE(reaches(link, "uav0", peer) && reaches(peer, "uav1", link));
  // Reported by now, so that it is not lost with the process.
  ASSERT_TRUE(eventually([&] { return link.statistics().request.received > 0; }));
  const std::uint64_t sent_before = link.statistics().request.sent;

  const pid_t process = process_of("uav0").value();
  const auto start = steady_clock::now();
  ASSERT_EQ(kill(process, GetParam()), 0);
  ASSERT_TRUE(eventually([&] { return restarts(link) == 1; }));
  EXPECT_TRUE(reaches(peer, "uav1", link));
  EXPECT_TRUE(reaches(link, "uav0", peer));
  const auto back = std::chrono::duration_cast<milliseconds>(steady_clock::now() - start);
  RecordProperty("back_ms", static_cast<int>(back.count()));
  EXPECT_LT(back, milliseconds(8000));  // 2 s, and what a busy machine and sanitizers add

  EXPECT_EQ(kill(process, 0), -1) << "still there, or a zombie";
  EXPECT_EQ(children_of(getpid()).size(), 1U);
  EXPECT_THAT(
      link.statistics().restarts,
      Contains(Key(GetParam() == SIGKILL ? "killed by signal 9 (SIGKILL)" : "did not report")));
  EXPECT_TRUE(eventually([&] { return link.statistics().request.sent > sent_before; }));
}

INSTANTIATE_TEST_SUITE_P(BySignal, LinkProcessEnds, testing::Values(SIGKILL, SIGSTOP),
                         [](const auto& signal) {
                           return signal.param == SIGKILL ? "Killed" : "Stopped";
                         });

TEST(LinkProcess, ADroneNeverWaitsForAProcessThatHangs) {
  LinkProcess link(drone("uav0"));
  ASSERT_EQ(kill(process_of("uav0").value(), SIGSTOP), 0);
  // More than the socket and the waiting records hold, before anybody notices.
  const PeerKeyframe large = samples::keyframe("uav0", "uav1", 256);
  for (int i = 0; i < 1000; ++i) (void)link.send(large);
  const LinkStatistics statistics = link.statistics();
  EXPECT_GT(statistics.message.refused, 100U);
  EXPECT_THAT(statistics.refused, Contains(Key(HasSubstr("the link"))));
}

TEST(LinkProcess, UsesNoSharedMemoryThatAKillCouldLeaveBehind) {
  const LinkProcess link(drone("uav0"));
  const std::string maps =
      file_content("/proc/" + std::to_string(process_of("uav0").value()) + "/maps");
  ASSERT_FALSE(maps.empty());
  EXPECT_EQ(maps.find("/dev/shm"), std::string::npos);
}

TEST(LinkProcess, OneThatGrowsIsStartedAnewBeforeItIsLarge) {
  AgentConfig config = drone("grow");
  config.link.max_memory_mib = 400;
  const LinkProcess link(config);
  ASSERT_TRUE(eventually([&] { return restarts(link) >= 2; }));
  EXPECT_THAT(link.statistics().restarts, Contains(Key("used more than link.max_memory_mib")));
}

// The second guard, against what grows faster than anybody looks.
TEST(LinkProcess, ATrueOneMayNotClaimMoreThanItsLimit) {
  AgentConfig config = drone("uav0");
  const LinkProcess link(config);
  const std::string process = std::to_string(process_of("uav0").value());
  const std::string limits = file_content("/proc/" + process + "/limits");
  const std::string line = limits.substr(limits.find("Max data size") + 13);
  const double limit_mib = std::stod(line) / 1024 / 1024;  // throws for "unlimited"
  EXPECT_LE(limit_mib, memory_mib(process, "VmData").value() + config.link.max_memory_mib);
}

TEST(LinkProcess, OneThatMisbehavesIsStartedAnewAndTheReasonIsCounted) {
  EXPECT_EQ(end_of("fall_silent"), "did not report");
  EXPECT_EQ(end_of("babble"), "said no record");
  EXPECT_EQ(end_of("report_nonsense"), "reported nonsense");
  EXPECT_THAT(children_of(getpid()), IsEmpty());
}

TEST(LinkProcess, WhatItPassesOnIsCheckedAsAStrangersWordsAre) {
  LinkProcess link(drone("slander"));
  ASSERT_TRUE(link.wait_for_inbox({10, 0}, kPatience));
  for (const Inbound& inbound : link.take())
    EXPECT_EQ(std::get<PlaceAdvert>(inbound).sender, "uav7");
  const auto rejected = link.statistics().rejected.at("link's process");
  EXPECT_THAT(rejected, Contains(Key("another drone bears this drone's name")));
  EXPECT_GE(rejected.size(), 2U);
  EXPECT_EQ(restarts(link), 0U);
}

TEST(LinkProcess, WhatCannotStartSaysWhyInOneLine) {
  EXPECT_EQ(complaint(drone("give_up")), "link: no such radio?");
  EXPECT_EQ(complaint(drone("leave")),
            "the link cannot be started: its process ended with exit code 3");
  AgentConfig config = drone("uav0");
  config.link.team = "two words";
  EXPECT_THAT(complaint(config), HasSubstr("two words"));
  EXPECT_THAT(children_of(getpid()), IsEmpty());
}

}  // namespace
}  // namespace covey

int main(int argc, char** argv) {
  if (argc == 6 && std::string(argv[1]) == "link")
    return covey::play_link(argv[3], std::stoi(argv[5]));
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
