// SPDX-License-Identifier: Apache-2.0
//
// A team that no other process can hear.
#pragma once

#include <unistd.h>

#include <chrono>
#include <string>

#include "comms/peer_link.h"

namespace covey {

// Generous: a loaded machine makes a test slow, not red.
inline constexpr std::chrono::seconds kPatience{60};

inline LinkConfig team_config(const std::string& agent) {
  LinkConfig config;
  config.agent = agent;
  config.team = "test" + std::to_string(getpid());
  // No team's, and ports below those that systems hand out (apps/free_domain.cpp).
  config.domain = 61 + getpid() % 39;
  config.max_agents = 8;
  return config;
}

// As the profile `lockstep`: nothing is lost, nothing expires, no limit of the load.
inline LinkProfile lossless_profile() {
  LinkProfile out;
  for (TopicProfile* topic : {&out.request, &out.message, &out.full_message}) {
    topic->reliability = Reliability::kReliable;
    topic->history = History::kAll;
    topic->depth = 256;
    topic->lifespan_ms = 0;
    topic->max_blocking_ms = 30'000;
  }
  out.request.piggyback = true;
  out.load.drone_bytes_per_s = out.load.link_bytes_per_s = 0;
  out.status.liveliness_ms = out.discovery.lease_ms = 20'000;
  out.discovery.farewell_ms = 5000;
  return out;
}

}  // namespace covey
