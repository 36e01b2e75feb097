// SPDX-License-Identifier: Apache-2.0
//
// What a drone tells the people who look after it while it flies: each thing once, what happens to
// it as often as it does.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "apps/config_file.h"
#include "apps/pipeline.h"
#include "apps/start_doubt.h"
#include "comms/link.h"

namespace covey {

class FlightWarnings {
 public:
  // `line_delay_s`: as sensor.yaml says.
  FlightWarnings(const AgentConfig& config, double line_delay_s);

  // That the filter lost itself, and that the camera sees nothing or sees again. `started`: is
  // anything estimated?
  void of_image(const ImageResult& result, bool started);
  void of_camera(const Pipeline& pipeline);
  void of_link(const LinkStatistics& statistics);
  void of_team(const Pipeline& pipeline, const PeerCounts& counts);

 private:
  void of_sight(TimeNs stamp_ns, ImageContent content, bool started);
  void of_namesake(const LinkStatistics& statistics);
  void of_crowd(const LinkStatistics& statistics);
  void of_port(const LinkStatistics& statistics);
  void of_network(const LinkStatistics& statistics);
  void of_start(const Pipeline& pipeline, const PeerCounts& counts);
  void of_moves(const DriftFilter& team);

  double line_delay_s_;
  int max_agents_;
  int domain_;
  bool starts_should_fit_;
  std::optional<TimeNs> unseen_since_ns_;  // without a scene
  bool blind_ = false;                     // and that was said
  // Told already.
  bool rows_ = false, namesake_ = false, crowd_ = false, port_ = false, network_ = false,
       start_ = false;
  std::map<std::string, int> moves_;  // of peers' worlds
};

}  // namespace covey
