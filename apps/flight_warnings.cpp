// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_warnings.h"

#include <spdlog/spdlog.h>

#include <utility>

namespace covey {

FlightWarnings::FlightWarnings(const AgentConfig& config, double line_delay_s)
    : line_delay_s_(line_delay_s),
      max_agents_(config.link.max_agents),
      domain_(config.link.domain),
      starts_should_fit_(config.collaboration.exchange == ExchangeMode::kCompact &&
                         config.fusion.drift.common_start) {}

void FlightWarnings::of_image(const ImageResult& result, bool started) {
  const TimeNs stamp_ns = result.timing.stamp_ns;
  if (result.update.reinitialized) spdlog::warn("lost at image {} ns; starting anew", stamp_ns);
  of_sight(stamp_ns, result.content, started);
}

// An image that is merely given twice is nothing to speak of.
void FlightWarnings::of_sight(TimeNs stamp_ns, ImageContent content, bool started) {
  if (content == ImageContent::kScene) {
    if (blind_) {
      spdlog::info("the camera sees again after {:.2f} s",
                   seconds_between(*unseen_since_ns_, stamp_ns));
    }
    unseen_since_ns_.reset();
    blind_ = false;
    return;
  }
  if (!unseen_since_ns_) unseen_since_ns_ = stamp_ns;
  if (blind_ || !is_blind(content)) return;
  blind_ = true;
  spdlog::warn(
      "image {} ns {}: {} until the camera sees again", stamp_ns,
      content == ImageContent::kUniform ? "is uniform" : "still shows what those before it did",
      started ? "flying on inertial propagation" : "nothing is estimated");
}

void FlightWarnings::of_camera(const Pipeline& pipeline) {
  const std::optional<double> line_delay_s = pipeline.line_delay_found_s();
  if (rows_ || !line_delay_s) return;
  spdlog::warn(
      "the image seems to be read row by row, {:.0f} us or more each, and sensor.yaml says {:.0f}: "
      "has the camera a rolling shutter? That is its line_delay, in s",
      1e6 * *line_delay_s, 1e6 * line_delay_s_);
  rows_ = true;
}

void FlightWarnings::of_link(const LinkStatistics& statistics) {
  of_namesake(statistics);
  of_crowd(statistics);
  of_port(statistics);
  of_network(statistics);
}

// Both then ask and answer in one name, and nobody else can tell them apart.
void FlightWarnings::of_namesake(const LinkStatistics& statistics) {
  if (namesake_) return;
  for (const auto& [peer, reasons] : statistics.rejected) {
    if (reasons.count(kNamesake) == 0) continue;
    spdlog::warn("{}: give each drone of the team an agent.name of its own", kNamesake);
    namesake_ = true;
    return;
  }
}

void FlightWarnings::of_crowd(const LinkStatistics& statistics) {
  if (crowd_ || statistics.refused.count(kCrowd) == 0) return;
  spdlog::warn("{}, {}: some are not answered", kCrowd, max_agents_);
  crowd_ = true;
}

// It finds those who sit where all look, and nobody else who does not.
void FlightWarnings::of_port(const LinkStatistics& statistics) {
  if (port_ || statistics.unseen_port == 0) return;
  spdlog::warn(
      "the link listens at UDP port {}, where no drone looks for another: programs of this "
      "computer, as ROS 2's are, have taken the ports before it in DDS domain {}; give all drones "
      "a link.domain that no other program uses, or, where several of them share a computer, "
      "raise discovery.ports_per_host",
      statistics.unseen_port, domain_);
  port_ = true;
}

// Once: a radio may come and go, and status.json tells of now.
void FlightWarnings::of_network(const LinkStatistics& statistics) {
  if (network_ || statistics.missing_network.empty()) return;
  spdlog::warn("{}: the link uses it as soon as it is there, and the drone flies on",
               statistics.missing_network);
  network_ = true;
}

void FlightWarnings::of_team(const Pipeline& pipeline, const PeerCounts& counts) {
  of_start(pipeline, counts);
  if (const DriftFilter* team = pipeline.team_knowledge()) of_moves(*team);
}

void FlightWarnings::of_start(const Pipeline& pipeline, const PeerCounts& counts) {
  const std::optional<CollaboratorReport> report = pipeline.collaboration();
  if (start_ || !starts_should_fit_ || !report) return;
  const std::optional<std::string> doubt = doubt_of_start(counts, *report);
  if (!doubt) return;
  spdlog::warn("{}", *doubt);
  start_ = true;
}

void FlightWarnings::of_moves(const DriftFilter& team) {
  for (const std::string& peer : team.peers()) {
    const int moves = team.moves(peer);
    if (std::exchange(moves_[peer], moves) < moves) spdlog::warn("{}", words_on_move(peer, team));
  }
}

}  // namespace covey
