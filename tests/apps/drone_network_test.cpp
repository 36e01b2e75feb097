// SPDX-License-Identifier: Apache-2.0
//
// Real namespaces with a few packets in them. Skipped, saying why, where nobody may make any.
#include "apps/drone_network.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <thread>

#include "apps/process_usage.h"
#include "tests/comms/eventually.h"

namespace covey {
namespace {

constexpr int kPort = 7700;
constexpr int kPatience_ms = 2000;

sockaddr_in address(const std::string& ip) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(kPort);
  inet_pton(AF_INET, ip.c_str(), &out.sin_addr);
  return out;
}

// A socket lives in the namespace of the thread that makes it.
FileDescriptor socket_inside(const DroneNetwork& network, std::size_t drone) {
  FileDescriptor made;
  std::thread([&] {
    ASSERT_EQ(setns(network.namespace_of(drone), CLONE_NEWNET), 0);
    made = FileDescriptor(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const sockaddr_in own = address("0.0.0.0");
    ASSERT_EQ(bind(made.get(), reinterpret_cast<const sockaddr*>(&own), sizeof(own)), 0);
  }).join();
  return made;
}

void say(const FileDescriptor& from, std::size_t to, const std::string& words) {
  const sockaddr_in peer = address(drone_address(to));
  ASSERT_EQ(sendto(from.get(), words.data(), words.size(), 0,
                   reinterpret_cast<const sockaddr*>(&peer), sizeof(peer)),
            static_cast<ssize_t>(words.size()));
}

// Empty when nothing comes.
std::string hear(const FileDescriptor& socket, int patience_ms) {
  pollfd input{socket.get(), POLLIN, 0};
  if (poll(&input, 1, patience_ms) != 1) return "";
  char buffer[2048];
  const ssize_t size = recv(socket.get(), buffer, sizeof(buffer), 0);
  return {buffer, static_cast<std::size_t>(std::max<ssize_t>(size, 0))};
}

// Descriptors of this process that keep a namespace or its device alive.
std::set<std::string> network_holders() {
  std::set<std::string> holders;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;  // the descriptor that lists the folder
    const std::string target = std::filesystem::read_symlink(entry.path(), gone).string();
    if (target.rfind("net:", 0) == 0 || target == "/dev/net/tun") {
      holders.insert(entry.path().filename().string() + " " + target);
    }
  }
  return holders;
}

NetworkModel clear_network(std::size_t drones) {
  NetworkModel model;
  model.drones = drones;
  return model;
}

class DroneNetworkTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_namespaces()) GTEST_SKIP() << *why;
  }
};

TEST_F(DroneNetworkTest, WhoIsNotRootIsTold) {
  const pid_t child = fork();
  if (child == 0) {
    const bool told =
        setuid(65534) == 0 && why_no_namespaces().value_or("").find("root") != std::string::npos;
    _exit(told ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
}

TEST_F(DroneNetworkTest, PacketsPassAndAreCounted) {
  DroneNetwork network(clear_network(3), 1);
  const FileDescriptor a = socket_inside(network, 0), b = socket_inside(network, 1),
                       c = socket_inside(network, 2);
  say(a, 1, "hello");
  EXPECT_EQ(hear(b, kPatience_ms), "hello");
  say(b, 0, std::string(1400, 'x'));
  EXPECT_EQ(hear(a, kPatience_ms).size(), 1400U);
  EXPECT_EQ(hear(c, 0), "") << "it was not meant for the third";

  const std::vector<PortCounts> counts = network.frames().counts();
  EXPECT_EQ(counts[0].bytes_sent, 14U + 20 + 8 + 5);  // Ethernet, IPv4, UDP
  EXPECT_EQ(counts[1].bytes_sent, 14U + 20 + 8 + 1400);
  EXPECT_EQ(counts[0].delivered, 1U);
  EXPECT_EQ(counts[2].frames_sent, 0U);
}

TEST_F(DroneNetworkTest, APartitionOfTheFlightIsKeptToByTheSwitch) {
  NetworkModel model = clear_network(2);
  model.partitions = {{0, 1000, {0}}};
  DroneNetwork network(model, 1);
  const FileDescriptor a = socket_inside(network, 0), b = socket_inside(network, 1);
  say(a, 1, "before");
  EXPECT_EQ(hear(b, kPatience_ms), "before");
  network.frames().begin_flight(steady_ms(), 1);
  say(a, 1, "during");
  ASSERT_TRUE(eventually([&] { return network.frames().counts()[0].frames_sent == 2; }));
  EXPECT_EQ(network.frames().counts()[0].cut, 1U);
}

TEST_F(DroneNetworkTest, NobodyHoldsANamespaceAfterwardsSoTheKernelTakesItAway) {
  const std::set<std::string> before = network_holders();
  auto network = std::make_unique<DroneNetwork>(clear_network(2), 1);
  EXPECT_EQ(network_holders().size(), before.size() + 4);  // two namespaces and their devices
  network.reset();
  EXPECT_EQ(network_holders(), before);
}

}  // namespace
}  // namespace covey
