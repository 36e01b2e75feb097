// SPDX-License-Identifier: Apache-2.0
#include "comms/access_rules.h"

#include <array>
#include <ctime>
#include <vector>

#include "comms/xml_tag.h"

namespace covey {
namespace {

using std::chrono::hours;
using std::chrono::system_clock;

// What follows is compact: permissions travel in every handshake.
constexpr char kHead[] = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";

std::string domains_xml(const DomainRange& domains) {
  return tag("domains", tag("id_range", tag("min", std::to_string(domains.first)) +
                                            tag("max", std::to_string(domains.last))));
}

std::string topics_xml(const std::vector<std::string>& topics) {
  std::string out;
  for (const std::string& topic : topics) out += tag("topic", topic);
  return tag("topics", out);
}

std::string date(system_clock::time_point time) {
  const std::time_t seconds = system_clock::to_time_t(time);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &utc);
  return text.data();
}

// Fast DDS reads the dates as local time: a day more at both ends, so that the certificate's, which
// say UTC, are those that hold.
std::string validity_xml(const Validity& validity) {
  return tag("validity", tag("not_before", date(validity.from - hours(24))) +
                             tag("not_after", date(validity.until + hours(24))));
}

}  // namespace

std::string governance_xml(const std::string& team, const DomainRange& domains) {
  const std::string topics = tag(
      "topic_rule",
      tag("topic_expression", "covey/" + team + "/*") + tag("enable_discovery_protection", "true") +
          tag("enable_liveliness_protection", "true") + tag("enable_read_access_control", "true") +
          tag("enable_write_access_control", "true") + tag("metadata_protection_kind", "NONE") +
          tag("data_protection_kind", "ENCRYPT"));
  const std::string rule = tag(
      "domain_rule", domains_xml(domains) + tag("allow_unauthenticated_participants", "false") +
                         tag("enable_join_access_control", "true") +
                         tag("discovery_protection_kind", "ENCRYPT") +
                         tag("liveliness_protection_kind", "ENCRYPT") +
                         tag("rtps_protection_kind", "NONE") + tag("topic_access_rules", topics));
  return kHead + tag("dds", tag("domain_access_rules", rule));
}

std::string permissions_xml(const Subject& drone, const DomainRange& domains,
                            const Validity& validity) {
  const std::string team = "covey/" + drone.team;
  const std::vector<std::string> for_all = {team + "/request", team + "/status",
                                            team + "/odometry"};
  std::vector<std::string> writes = for_all, reads = for_all;
  for (const std::string& answers : {team + "/message/", team + "/full_message/"}) {
    writes.push_back(answers + "*");
    reads.push_back(answers + drone.name);
  }
  const std::string grant =
      tag("subject_name", distinguished_name(drone)) + validity_xml(validity) +
      tag("allow_rule", domains_xml(domains) + tag("publish", topics_xml(writes)) +
                            tag("subscribe", topics_xml(reads))) +
      tag("default", "DENY");
  return kHead + tag("dds", tag("permissions", tag("grant name=\"" + drone.name + "\"", grant)));
}

}  // namespace covey
