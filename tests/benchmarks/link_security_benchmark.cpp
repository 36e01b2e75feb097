// SPDX-License-Identifier: Apache-2.0
//
// What DDS Security costs: an answer of the usual size from one drone to another on this machine,
// CPU of both ends together, and bytes on the wire of both for each byte of payload.

#include <benchmark/benchmark.h>

#include <stdexcept>

#include "tests/comms/samples.h"
#include "tests/comms/secure_team.h"

namespace covey {
namespace {

constexpr std::size_t kLandmarks = 95;

std::uint64_t wire_bytes(const PeerLink& link) {
  const LinkStatistics statistics = link.statistics();
  return statistics.wire_bytes_sent + statistics.wire_bytes_received;
}

LinkConfig open_config(const std::string& agent) {
  LinkConfig config = team_config(agent);
  config.profile = lossless_profile();  // as that of SecureTeam
  return config;
}

void send_answers(benchmark::State& timing, const LinkConfig& from, const LinkConfig& to) {
  PeerLink sender(from), receiver(to);
  if (!sender.wait_for_peers({to.agent}, kPatience) ||
      !receiver.wait_for_peers({from.agent}, kPatience))
    throw std::runtime_error("the drones have not found each other");
  const PeerKeyframe answer = samples::keyframe(from.agent, to.agent, kLandmarks);
  const std::uint64_t before = wire_bytes(sender);
  for (auto _ : timing) {
    sender.send(answer);
    const ArrivalCounts all{0, sender.statistics().message.sent};
    if (!receiver.wait_for_inbox(all, kPatience)) throw std::runtime_error("an answer is lost");
    benchmark::DoNotOptimize(receiver.take());
  }
  const auto payload = static_cast<double>(sender.statistics().message.payload_bytes_sent);
  timing.counters["wire/payload"] = static_cast<double>(wire_bytes(sender) - before) / payload;
}

void BM_OpenAnswer(benchmark::State& timing) {
  send_answers(timing, open_config("uav0"), open_config("uav1"));
}
BENCHMARK(BM_OpenAnswer)->MeasureProcessCPUTime()->Unit(benchmark::kMicrosecond);

void BM_SecuredAnswer(benchmark::State& timing) {
  const SecureTeam team({"uav0", "uav1"});
  send_answers(timing, team.config("uav0"), team.config("uav1"));
}
BENCHMARK(BM_SecuredAnswer)->MeasureProcessCPUTime()->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace covey
