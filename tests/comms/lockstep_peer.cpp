// SPDX-License-Identifier: Apache-2.0
//
// One drone of a lockstep team, as small as it can be: in every round it asks, waits for
// everybody's question, answers each, waits for everybody's answer.
//   covey_comms_peer TEAM DOMAIN ROUNDS SELF PEER...     exit 0: nothing was lost, dropped or
//   refused
// With 0 rounds it says "linked" and then stays until it is killed.
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <set>
#include <stdexcept>
#include <string>

#include "comms/peer_link.h"
#include "tests/comms/samples.h"
#include "tests/comms/team_config.h"

namespace covey {
namespace {

constexpr std::chrono::seconds kPatience{60};

void require(bool good, const std::string& what) {
  if (!good) throw std::runtime_error(what);
}

void play_round(PeerLink& link, const std::string& self, std::uint64_t round, std::size_t peers) {
  require(link.send(samples::advert(self, round)), "request not sent");
  require(link.wait_for_inbox({round * peers, (round - 1) * peers}, kPatience),
          "round " + std::to_string(round) + ": requests missing");
  for (const Inbound& inbound : link.take()) {
    if (const auto* advert = std::get_if<PlaceAdvert>(&inbound))
      require(link.send(samples::keyframe(self, advert->sender, 30)), "answer not sent");
  }
  require(link.wait_for_inbox({round * peers, round * peers}, kPatience),
          "round " + std::to_string(round) + ": answers missing");
}

void run(const LinkConfig& config, std::uint64_t rounds, const std::set<std::string>& peers) {
  PeerLink link(config);
  require(link.wait_for_peers(peers, kPatience), "peers missing");
  std::cout << "linked" << std::endl;
  if (rounds == 0) (void)link.wait_for_inbox({UINT64_MAX, 0}, std::chrono::minutes(5));
  for (std::uint64_t round = 1; round <= rounds; ++round)
    play_round(link, config.agent, round, peers.size());
  const LinkStatistics statistics = link.statistics();
  require(statistics.request.received == rounds * peers.size(), "requests lost");
  require(statistics.message.received == rounds * peers.size(), "answers lost");
  require(statistics.inbox_dropped == 0, "inbox dropped");
  require(statistics.rejected.empty() && statistics.refused.empty(), "rejected or refused");
}

}  // namespace
}  // namespace covey

int main(int argc, char** argv) {
  if (argc < 6) return 2;
  covey::LinkConfig config;
  config.team = argv[1];
  config.domain = std::atoi(argv[2]);
  config.agent = argv[4];
  config.max_agents = 8;
  const auto rounds = static_cast<std::uint64_t>(std::atoll(argv[3]));
  // Killed drones are noticed by the radio's short leases.
  if (rounds > 0) config.profile = covey::lossless_profile();
  try {
    covey::run(config, rounds, {argv + 5, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << config.agent << ": " << error.what() << "\n";
    return 1;
  }
  return 0;
}
