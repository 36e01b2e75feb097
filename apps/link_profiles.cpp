// SPDX-License-Identifier: Apache-2.0
#include "apps/link_profiles.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "apps/config_json.h"
#include "apps/json_file.h"
#include "apps/shipped_profiles.h"

namespace covey {
namespace {

using Json = nlohmann::json;

constexpr double kHour_ms = 3.6e6;

void visit_topic(const char* name, TopicProfile& topic, ConfigVisitor& v) {
  v.begin_section(name);
  v.option("reliability", topic.reliability, {"best_effort", "reliable"}, "repaired or not");
  v.option("history", topic.history, {"last", "all"}, "the newest, or until all acknowledged");
  v.count("depth", topic.depth, {1, 1000}, "samples kept per sender");
  v.flag("late_joiners", topic.late_joiners, "get what is kept");
  v.count("lifespan_ms", topic.lifespan_ms, {0, kHour_ms}, "[ms] then it is dropped; 0: never");
  v.count("deadline_ms", topic.deadline_ms, {0, kHour_ms}, "[ms] between two samples; 0: any");
  v.count("liveliness_ms", topic.liveliness_ms, {0, kHour_ms},
          "[ms] without a sign of life a sender is gone; 0: not watched");
  v.count("max_blocking_ms", topic.max_blocking_ms, {0, kHour_ms}, "[ms] when a history is full");
  v.count("heartbeat_ms", topic.heartbeat_ms, {1, 1e5}, "[ms] between two offers to repair");
  v.flag("piggyback", topic.piggyback, "an offer with every datagram as well");
  v.count("heartbeat_response_ms", topic.heartbeat_response_ms, {0, 1e5},
          "[ms] from an offer to what is missed");
  v.count("nack_response_ms", topic.nack_response_ms, {0, 1e5}, "[ms] from there to the repair");
  v.count("flow_bytes", topic.flow_bytes, {0, 1e9}, "in flow_period_ms; 0: at once");
  v.count("flow_period_ms", topic.flow_period_ms, {1, 1e5}, "[ms]");
  v.end_section();
}

void visit_transport(TransportProfile& transport, ConfigVisitor& v) {
  v.begin_section("transport");
  v.count("datagram_bytes", transport.datagram_bytes, {512, 65000}, "of UDP payload at most");
  v.count("socket_buffer_kib", transport.socket_buffer_kib, {16, 65536}, "[KiB] each way");
  v.count("full_message_buffer_kib", transport.full_message_buffer_kib, {16, 65536},
          "[KiB] instead, where whole filters are exchanged");
  v.end_section();
}

void visit_discovery(DiscoveryProfile& discovery, ConfigVisitor& v) {
  v.begin_section("discovery");
  v.option("mode", discovery.mode, {"unicast", "multicast", "server"}, "how drones are found");
  v.count("lease_ms", discovery.lease_ms, {100, kHour_ms}, "[ms] of silence until forgotten");
  v.count("announcement_ms", discovery.announcement_ms, {10, kHour_ms},
          "[ms] between two, while anybody is missing");
  v.count("sign_of_life_ms", discovery.sign_of_life_ms, {50, kHour_ms},
          "[ms] after anything else was said to all");
  v.count("first_announcements", discovery.first_announcements, {0, 100}, "in quick succession");
  v.count("first_announcement_ms", discovery.first_announcement_ms, {1, 1e5}, "[ms] between two");
  v.count("repeat_ms", discovery.repeat_ms, {0, 1e5},
          "[ms] after which newcomers that do not get on are told again what this drone reads and "
          "writes, unless there are more than eight others; 0: never");
  v.count("ports_per_host", discovery.ports_per_host, {1, 100}, "where drones are looked for");
  v.count("farewell_ms", discovery.farewell_ms, {0, 1e5}, "[ms] for the last acknowledgements");
  v.end_section();
}

void visit_load(LoadProfile& load, ConfigVisitor& v) {
  v.begin_section("load");
  v.count("drone_bytes_per_s", load.drone_bytes_per_s, {0, 1e9},
          "[B/s] of this drone on the wire; 0: no limit");
  v.count("drone_burst_bytes", load.drone_burst_bytes, {0, 1e9}, "after silence");
  v.count("link_bytes_per_s", load.link_bytes_per_s, {0, 1e9},
          "[B/s] of samples to one peer; 0: no limit");
  v.count("link_burst_bytes", load.link_burst_bytes, {0, 1e9}, "after silence");
  v.count("patience_ms", load.patience_ms, {0, 1e4},
          "[ms] then what found no room is dropped; 0: at once");
  v.end_section();
}

void visit_security(SecurityProfile& security, ConfigVisitor& v) {
  v.begin_section("security");
  v.flag("required", security.required, "without keys (link.security) there is no link");
  v.end_section();
}

struct ProfileFile {
  std::string name;
  std::map<std::string, Json> profiles;
};

std::map<std::string, Json> profiles_in(const Json& json, const std::string& name) {
  const auto found = json.is_object() ? json.find("profiles") : json.end();
  if (found == json.end() || !found->is_object())
    throw std::runtime_error(name + ": holds no profiles: {\"profiles\": {NAME: {...}}}");
  return found->get<std::map<std::string, Json>>();
}

ProfileFile open_profiles(const std::string& file) {
  ProfileFile out;
  out.name = file.empty() ? "the program's profiles" : file;
  if (file.empty()) {
    out.profiles = profiles_in(Json::parse(kShippedProfiles), out.name);
    return out;
  }
  std::ifstream stream(file);
  if (!std::filesystem::is_regular_file(file) || !stream)
    throw std::runtime_error(file + ": the profiles cannot be read");
  out.profiles = profiles_in(parse_json(stream, file), out.name);
  return out;
}

const Json& named(const ProfileFile& file, const std::string& name, const std::string& where) {
  const auto found = file.profiles.find(name);
  if (found != file.profiles.end() && found->second.is_object()) return found->second;
  std::vector<std::string> names;
  for (const auto& item : file.profiles) names.push_back(item.first);
  throw std::runtime_error(where + ": no profile '" + name + "' in " + file.name +
                           " (there are: " + join(names, ", ") + ")");
}

// The one that all others are made from comes first.
std::vector<std::string> ancestry(const ProfileFile& file, std::string name,
                                  const std::string& where) {
  std::vector<std::string> line = {name};
  for (const Json* profile = &named(file, name, where); profile->contains("from");
       profile = &named(file, name, where)) {
    const Json& from = profile->at("from");
    if (!from.is_string())
      throw std::runtime_error(file.name + ": '" + name + ".from' is not a profile's name");
    name = from.get<std::string>();
    if (std::find(line.begin(), line.end(), name) != line.end())
      throw std::runtime_error(file.name + ": profile '" + name + "' is made from itself");
    line.insert(line.begin(), name);
  }
  return line;
}

// A profile without what is said about it.
Json values_of(const Json& profile) {
  Json values = profile;
  values.erase("why");
  values.erase("from");
  for (Json& section : values)
    if (section.is_object()) section.erase("why");
  return values;
}

void set(const Json& values, const std::string& where, LinkProfile& profile) {
  set_from_json(values, where, [&](ConfigVisitor& visitor) { visit_profile(profile, visitor); });
}

[[noreturn]] void fail_without_section(const std::string& path, const std::string& where) {
  throw std::runtime_error(where + ": '" + path +
                           "' names no section: write it as message.heartbeat_ms");
}

Json nested(const std::map<std::string, std::string>& overrides, const std::string& where) {
  Json sections = Json::object();
  for (const auto& [path, value] : overrides) {
    const auto dot = path.find('.');
    if (dot == std::string::npos) fail_without_section(path, where);
    sections[path.substr(0, dot)][path.substr(dot + 1)] = Json::parse(value);
  }
  return sections;
}

// For people to read; empty where there is none.
std::string reason_in(const ProfileFile& file, const std::string& name, const std::string& path) {
  const Json::json_pointer pointer(path);
  const Json& profile = file.profiles.at(name);
  if (!profile.is_object() || !profile.contains(pointer)) return "";
  const Json& reason = profile.at(pointer);
  if (reason.is_string()) return reason.get<std::string>();
  throw std::runtime_error(file.name + ": '" + name + path + "' is no text");
}

}  // namespace

void visit_profile(LinkProfile& profile, ConfigVisitor& visitor) {
  visit_transport(profile.transport, visitor);
  visit_discovery(profile.discovery, visitor);
  visit_load(profile.load, visitor);
  visit_security(profile.security, visitor);
  visit_topic("request", profile.request, visitor);
  visit_topic("message", profile.message, visitor);
  visit_topic("full_message", profile.full_message, visitor);
  visit_topic("status", profile.status, visitor);
  visit_topic("odometry", profile.odometry, visitor);
}

LinkProfile read_profile(const ProfileChoice& choice, const std::string& where) {
  const ProfileFile file = open_profiles(choice.file);
  LinkProfile profile;
  for (const std::string& name : ancestry(file, choice.name, where + ".profile"))
    set(values_of(file.profiles.at(name)), file.name + ": " + name, profile);
  const std::string override_name = where + ".override";
  set(nested(choice.overrides, override_name), override_name, profile);
  try {
    check(profile);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(where + ": " + error.what());
  }
  return profile;
}

std::vector<ProfileName> profile_names(const std::string& file) {
  const ProfileFile opened = open_profiles(file);
  std::vector<ProfileName> names;
  for (const auto& item : opened.profiles)
    names.push_back({item.first, reason_in(opened, item.first, "/why")});
  return names;
}

nlohmann::ordered_json profile_with_reasons(const ProfileChoice& choice, const std::string& where) {
  LinkProfile profile = read_profile(choice, where);
  const ProfileFile file = open_profiles(choice.file);
  const std::vector<std::string> line = ancestry(file, choice.name, where);
  const auto reason = [&](const std::string& section, const std::string& key) -> std::string {
    if (choice.overrides.count(std::string(section).append(".").append(key)) > 0)
      return "overridden by " + where;
    const std::string path = std::string("/").append(section).append("/why/").append(key);
    for (auto name = line.rbegin(); name != line.rend(); ++name)
      if (std::string why = reason_in(file, *name, path); !why.empty()) return why;
    return "";
  };
  auto json = to_ordered_json([&](ConfigVisitor& visitor) { visit_profile(profile, visitor); });
  for (const auto& [section, values] : json.items())
    for (auto& [key, value] : values.items())
      value = {{"value", value}, {"why", reason(section, key)}};
  return json;
}

}  // namespace covey
