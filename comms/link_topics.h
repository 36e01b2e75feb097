// SPDX-License-Identifier: Apache-2.0
//
// What the topics between drones are called and which types go over them, as idl/covey.idl has
// them. Who writes and who reads which: peer_link.h.
#pragma once

#include <cstddef>
#include <string>

#include "comms/byte_type.h"
#include "comms/convert.h"
#include "comms/link_state.h"
#include "comms/peer_link.h"

namespace covey {

struct LinkTopic {
  std::string name;
  const char* type = "";
  std::size_t max_bytes = 0;
  KeyOf key_of = nullptr;
};

// `receiver`: of messages, whose topics are all called alike but for its name at the end.
inline LinkTopic link_topic(Kind kind, const std::string& team, const std::string& receiver = "") {
  const std::string prefix = "covey/" + team;
  switch (kind) {
    case Kind::kRequest:
      return {prefix + "/request", "covey::wire::RequestUAV", kMaxRequestBytes};
    case Kind::kMessage:
      return {prefix + "/message/" + receiver, "covey::wire::MessageUAV", kMaxMessageBytes};
    case Kind::kFullMessage:
      return {prefix + "/full_message/" + receiver, "covey::wire::FullMessageUAV",
              kMaxFullMessageBytes};
    case Kind::kStatus:
      return {prefix + "/status", "covey::wire::AgentStatus", kMaxStatusBytes, key_of_status};
    case Kind::kOdometry:
      break;
  }
  return {prefix + "/odometry", "covey::wire::Odometry", kMaxOdometryBytes};
}

// The sort of messages that the drones of a team exchange.
inline Kind message_kind(const LinkConfig& config) {
  return config.full_messages ? Kind::kFullMessage : Kind::kMessage;
}

}  // namespace covey
