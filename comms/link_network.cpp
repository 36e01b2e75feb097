// SPDX-License-Identifier: Apache-2.0
#include "comms/link_network.h"

#include <algorithm>

namespace covey {
namespace {

constexpr char kLoopback[] = "127.0.0.1";

bool is_loopback(const OwnAddress& own) { return own.address.rfind("127.", 0) == 0; }

std::string problem_with(const std::string& interface, const std::vector<OwnAddress>& own) {
  const auto is_it = [&](const OwnAddress& each) { return each.address == interface; };
  if (std::none_of(own.begin(), own.end(), is_it)) return "is no address of this computer now";
  const auto runs = [&](const OwnAddress& each) { return is_it(each) && each.running; };
  return std::any_of(own.begin(), own.end(), runs) ? "" : "has no carrier";
}

LinkNetwork of_named(const std::vector<std::string>& interfaces,
                     const std::vector<OwnAddress>& own) {
  LinkNetwork network;
  for (const std::string& interface : interfaces) {
    const std::string problem = problem_with(interface, own);
    if (problem.empty()) {
      network.usable.insert(interface);
    } else {
      if (!network.missing.empty()) network.missing += ", ";
      network.missing.append("link.interfaces \"").append(interface).append("\" ").append(problem);
    }
  }
  return network;
}

LinkNetwork of_all(const std::vector<OwnAddress>& own) {
  LinkNetwork network;
  for (const OwnAddress& each : own)
    if (each.running && !is_loopback(each)) network.usable.insert(each.address);
  if (network.usable.empty()) network.missing = "no interface has an address and a carrier";
  return network;
}

}  // namespace

LinkNetwork link_network(const LinkConfig& config, const std::vector<OwnAddress>& own) {
  if (config.loopback_only) return {{kLoopback}, ""};
  return config.interfaces.empty() ? of_all(own) : of_named(config.interfaces, own);
}

std::optional<LinkConfig> on_what_is_there(LinkConfig config, const LinkNetwork& network) {
  if (config.loopback_only || config.interfaces.empty()) return config;
  if (network.usable.empty()) return std::nullopt;
  std::vector<std::string>& named = config.interfaces;
  const auto is_missing = [&](const std::string& each) { return network.usable.count(each) == 0; };
  named.erase(std::remove_if(named.begin(), named.end(), is_missing), named.end());
  return config;
}

bool uses_too_little(const std::set<std::string>& used, const LinkNetwork& network) {
  const std::set<std::string>& usable = network.usable;
  return !std::includes(used.begin(), used.end(), usable.begin(), usable.end());
}

}  // namespace covey
