// SPDX-License-Identifier: Apache-2.0
#include "comms/config_check.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <string>
#include <vector>

#include "comms/checks.h"
#include "comms/key_folder.h"
#include "comms/link_require.h"
#include "comms/own_addresses.h"

namespace covey {
namespace {

void check_name(const char* setting, const std::string& name) {
  require(is_agent_name(name), std::string(setting) + " \"" + name +
                                   "\" is not a name: use 1..32 characters of [A-Za-z0-9_-]");
}

void check_range(const char* setting, int value, int low, int high) {
  require(value >= low && value <= high, std::string(setting) + " " + std::to_string(value) +
                                             " is not in " + std::to_string(low) + ".." +
                                             std::to_string(high));
}

void check_address(const char* setting, const std::string& address) {
  in_addr parsed{};
  require(
      inet_pton(AF_INET, address.c_str(), &parsed) == 1,
      std::string(setting) + " \"" + address + "\" is not an IPv4 address: write it as 10.0.0.2");
}

// Fast DDS would go on without an interface that is not there, deaf and mute.
void check_interface(const std::string& interface) {
  check_address("interfaces", interface);
  const std::vector<OwnAddress> own = own_addresses();
  std::string list;
  for (const OwnAddress& each : own) list += " " + each.address;
  require(std::any_of(own.begin(), own.end(),
                      [&](const OwnAddress& each) { return each.address == interface; }),
          "interfaces \"" + interface + "\" is no address of this machine, which has:" + list);
}

void check_server(const std::string& server) {
  const auto colon = server.find(':');
  char* end = nullptr;
  const std::string port = colon == std::string::npos ? "" : server.substr(colon + 1);
  const long number = std::strtol(port.c_str(), &end, 10);
  require(!port.empty() && *end == '\0' && number > 0 && number < 65536,
          "discovery_server \"" + server + "\" is not an address: write it as 10.0.0.1:11811");
  check_address("discovery_server", server.substr(0, colon));
}

void check_discovery(const LinkConfig& config) {
  const DiscoveryMode mode = config.profile.discovery.mode;
  if (mode == DiscoveryMode::kServer) check_server(config.discovery_server);
  if (config.loopback_only) return;
  for (const std::string& interface : config.interfaces) check_interface(interface);
  for (const std::string& host : config.initial_peers) check_address("initial_peers", host);
  require(mode != DiscoveryMode::kUnicast || !config.initial_peers.empty(),
          "initial_peers is empty: list the addresses of the other drones, or choose "
          "discovery.mode multicast or server");
  require(mode != DiscoveryMode::kMulticast || config.initial_peers.empty(),
          "initial_peers are of no use with discovery.mode multicast: choose unicast");
}

void check_security(const LinkConfig& config) {
  require(!config.profile.security.required || !config.security.empty(),
          "security names no folder, and the profile requires keys: make them with `covey keys "
          "--team " +
              config.team + " --out keys " + config.agent + " ...` and set link.security to keys");
  if (config.security.empty()) return;
  check_keys(config);
  // Fast DDS 2.9.1 does not send a larger one in pieces, and the drones would not find each other.
  constexpr int kHandshakeBytes = 6000;
  require(config.profile.transport.datagram_bytes >= kHandshakeBytes,
          "transport.datagram_bytes of the profile is " +
              std::to_string(config.profile.transport.datagram_bytes) +
              ", and the handshake of DDS Security needs " + std::to_string(kHandshakeBytes) +
              ": choose the profile secure, or override it as that profile does");
}

}  // namespace

void check(const LinkConfig& config) {
  check_name("agent", config.agent);
  check_name("team", config.team);
  check_range("domain", config.domain, 0, 200);
  check_range("max_agents", config.max_agents, 2, kMaxAgents);
  check_range("team_size", config.team_size, 0, config.max_agents);
  require(config.inbox_limit > 0, "inbox_limit is 0: nothing could be received");
  check(config.profile);
  check_discovery(config);
  check_security(config);
  // It would quietly replace the discovery that keeps us on the chosen interfaces.
  require(std::getenv("ROS_DISCOVERY_SERVER") == nullptr,
          "ROS_DISCOVERY_SERVER is set and would redirect discovery: unset it");
}

std::set<in_addr_t> other_drones(const LinkConfig& config) {
  const DiscoveryProfile& discovery = config.profile.discovery;
  if (config.loopback_only || discovery.mode != DiscoveryMode::kUnicast ||
      discovery.ports_per_host > 1)
    return {};
  std::set<std::string> others(config.initial_peers.begin(), config.initial_peers.end());
  for (const OwnAddress& own : own_addresses()) others.erase(own.address);
  std::set<in_addr_t> addresses;
  for (const std::string& other : others) addresses.insert(inet_addr(other.c_str()));
  return addresses;
}

}  // namespace covey
