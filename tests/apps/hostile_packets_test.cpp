// SPDX-License-Identifier: Apache-2.0
//
// A team flies while somebody throws mutated copies of its own RTPS packets at all of its ports.
// Fast DDS may crash, hang or grow; the drones may not lose an image by it, and must talk again
// afterwards. All of it happens in a network namespace of its own.
//
// How much is thrown can be set, for long runs:
//   COVEY_HOSTILE_PACKETS=300000 COVEY_HOSTILE_SEED=7 COVEY_HOSTILE_PACE=0.02 covey_hostile_tests
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "apps/agent.h"
#include "apps/file_descriptor.h"
#include "apps/process_usage.h"
#include "comms/convert.h"
#include "tests/apps/covey_process.h"
#include "tests/comms/eventually.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uint16_t kFirstPort = 7400;

struct Datagram {
  std::uint16_t port = 0;  // to which it went
  Bytes bytes;             // UDP payload
};

double number_from_environment(const char* name, double otherwise) {
  const char* value = std::getenv(name);
  return value == nullptr ? otherwise : std::atof(value);
}

// Nothing of this process and its children reaches a real network from now on. Why not, if not.
std::string enter_own_network() {
  if (unshare(CLONE_NEWNET) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
    return std::strerror(errno);
  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq loopback{};
  std::strncpy(static_cast<char*>(loopback.ifr_name), "lo", IFNAMSIZ - 1);
  loopback.ifr_flags = IFF_UP | IFF_RUNNING;
  return ioctl(socket.get(), SIOCSIFFLAGS, &loopback) == 0 ? "" : std::strerror(errno);
}

// All that is said on the loopback.
class Eavesdropper {
 public:
  Eavesdropper() : socket_(::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC, htons(ETH_P_IP))) {}

  [[nodiscard]] bool hears() const { return socket_.get() >= 0; }

  // The next RTPS packet; nothing if there is none for 10 ms.
  std::optional<Datagram> next() {
    timeval patience{0, 10'000};
    setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    std::array<std::uint8_t, 65536> packet{};
    sockaddr_ll from{};
    socklen_t from_size = sizeof(from);
    const ssize_t size = recvfrom(socket_.get(), packet.data(), packet.size(), 0,
                                  reinterpret_cast<sockaddr*>(&from), &from_size);
    // Each packet is seen twice: when it leaves and when it arrives.
    if (size <= 0 || from.sll_pkttype == PACKET_OUTGOING) return std::nullopt;
    return rtps_in(packet.data(), static_cast<std::size_t>(size));
  }

 private:
  static std::optional<Datagram> rtps_in(const std::uint8_t* packet, std::size_t size) {
    if (size < sizeof(iphdr)) return std::nullopt;
    const std::size_t ip_bytes = 4 * std::size_t{packet[0] & 0x0fU};
    const std::size_t start = ip_bytes + sizeof(udphdr);
    if (packet[9] != IPPROTO_UDP || size < start + 4) return std::nullopt;
    if (std::memcmp(packet + start, "RTPS", 4) != 0) return std::nullopt;
    const auto port = static_cast<std::uint16_t>(packet[ip_bytes + 2] << 8 | packet[ip_bytes + 3]);
    return Datagram{port, Bytes(packet + start, packet + size)};
  }

  FileDescriptor socket_;
};

// What a team says while it meets and flies: a sample of it, and the ports where it listens.
struct Conversation {
  std::vector<Datagram> datagrams;
  std::set<std::uint16_t> ports;
};

Conversation listen(Eavesdropper& ear, std::size_t datagrams) {
  Conversation heard;
  const double deadline_ms = steady_ms() + 60'000;
  while (heard.datagrams.size() < datagrams && steady_ms() < deadline_ms) {
    if (auto datagram = ear.next(); datagram && datagram->port >= kFirstPort) {
      heard.ports.insert(datagram->port);
      heard.datagrams.push_back(*std::move(datagram));
    }
  }
  return heard;
}

class Mutator {
 public:
  Mutator(const std::vector<Datagram>& originals, unsigned seed)
      : originals_(originals), random_(seed) {}

  // Damaged in one to four places, often where a length or a number of elements stands.
  Datagram next() {
    Datagram out = any();
    for (std::size_t hits = 1 + below(4); hits > 0; --hits) damage(out.bytes);
    return out;
  }

 private:
  std::size_t below(std::size_t limit) { return random_() % limit; }
  const Datagram& any() { return originals_[below(originals_.size())]; }

  void damage(Bytes& bytes) {
    constexpr std::size_t kHeader = 20;  // of RTPS; damaged, the rest is not even read
    if (bytes.size() < kHeader + 8) return;
    const std::size_t at = kHeader + below(bytes.size() - kHeader - 4);
    switch (below(6)) {
      case 0:
        bytes[at] = static_cast<std::uint8_t>(random_());
        break;
      case 1:
        bytes[at] ^= static_cast<std::uint8_t>(1U << below(8));
        break;
      case 2: {
        constexpr std::array<std::uint32_t, 6> kLengths = {0,          1,          0xffff,
                                                           0x10000000, 0x7fffffff, 0xffffffff};
        std::memcpy(&bytes[at], &kLengths[below(kLengths.size())], 2 + 2 * below(2));
        break;
      }
      case 3:
        bytes.resize(at);
        break;
      case 4:
        bytes.insert(bytes.begin() + static_cast<long>(at), bytes.begin() + kHeader,
                     bytes.begin() + static_cast<long>(at));
        bytes.resize(std::min<std::size_t>(bytes.size(), 60'000));
        break;
      default: {
        const Bytes& other = any().bytes;
        const std::size_t from = std::min(at, other.size());
        bytes.resize(at);
        bytes.insert(bytes.end(), other.begin() + static_cast<long>(from), other.end());
      }
    }
  }

  const std::vector<Datagram>& originals_;
  std::mt19937 random_;
};

// A packet each 0.25 ms, now and then to another port than the one that it was made for.
void attack(const Conversation& heard, std::size_t packets, unsigned seed) {
  Mutator mutator(heard.datagrams, seed);
  std::mt19937 random(seed);
  const std::vector<std::uint16_t> ports(heard.ports.begin(), heard.ports.end());
  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto due = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < packets; ++i) {
    const Datagram datagram = mutator.next();
    to.sin_port = htons(random() % 8 == 0 ? ports[random() % ports.size()] : datagram.port);
    (void)sendto(socket.get(), datagram.bytes.data(), datagram.bytes.size(), 0,
                 reinterpret_cast<const sockaddr*>(&to), sizeof(to));
    std::this_thread::sleep_until(due += std::chrono::microseconds(250));
  }
}

json status_of(const fs::path& drone) {
  return json::parse(file_content(drone / kAgentStatusFile));
}

// In flight: at its end others may have left before. Its status is written once a second.
bool finds_its_peer_again(const fs::path& drone) {
  const json now = status_of(drone);
  return eventually([&] {
    const json later = status_of(drone);
    return later["frames"] > now["frames"] && later["peers"].size() == 1;
  });
}

struct Heard {
  std::size_t questions = 0, answers = 0;
};

// From its peers, after that moment.
Heard heard_since(const fs::path& drone, double clock_ms) {
  Heard heard;
  for (const ExchangeRecord& record : read_exchange(drone / kExchangeFile)) {
    if (record.clock_ms < clock_ms) continue;
    if (record.event == ExchangeEvent::kHeard) ++heard.questions;
    if (record.event == ExchangeEvent::kFused || record.event == ExchangeEvent::kGated ||
        record.event == ExchangeEvent::kRejected)
      ++heard.answers;
  }
  return heard;
}

TEST(HostilePackets, NoImageIsLostAndTheTeamTalksAgain) {
  if (const std::string why = enter_own_network(); !why.empty())
    GTEST_SKIP() << "no network namespace can be made: " << why;
  Eavesdropper ear;
  if (!ear.hears()) GTEST_SKIP() << "packets cannot be recorded: " << std::strerror(errno);
  const auto packets =
      static_cast<std::size_t>(number_from_environment("COVEY_HOSTILE_PACKETS", 6000));
  const auto seed = static_cast<unsigned>(number_from_environment("COVEY_HOSTILE_SEED", 7));
  const double pace = number_from_environment("COVEY_HOSTILE_PACE", 0.25);

  const fs::path run = fs::path(testing::TempDir()) / "covey_hostile_packets";
  fs::remove_all(run);
  const fs::path config = run.string() + ".json";
  // A machine that is busy with crashes reads images late; none may be dropped for that.
  std::ofstream(config) << R"({"agent": {"image_queue": 1000}})";
  CoveyProcess covey({"team", COVEY_TEST_FLIGHT, "--config", config.string(), "--out", run.string(),
                      "--pace", std::to_string(pace)});
  const Conversation heard = listen(ear, 80);
  ASSERT_GE(heard.ports.size(), 4U) << covey.output();
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  attack(heard, packets, seed);
  const double end_ms = steady_ms();
  for (const char* drone : {"uav0", "uav1"})
    EXPECT_TRUE(finds_its_peer_again(run / drone)) << drone;
  ASSERT_EQ(covey.finish(), 0) << covey.output();

  const json agents = json::parse(file_content(run / "summary.json"))["agents"];
  for (const char* drone : {"uav0", "uav1"}) {
    const json& agent = agents[drone];
    EXPECT_EQ(agent["frames"], COVEY_TEST_FLIGHT_FRAMES);
    EXPECT_EQ(agent["frames_dropped"], 0);
    EXPECT_LT(agent["max_rss_mib"], 1500);
    const Heard after = heard_since(run / drone, end_ms);
    std::cout << drone << ": " << agent["frames"] << " frames, " << agent["max_rss_mib"]
              << " MiB, heard afterwards " << after.questions << " questions and " << after.answers
              << " answers, link: " << agent["link"].dump() << "\n";
  }
  fs::remove_all(run);
}

}  // namespace
}  // namespace covey
