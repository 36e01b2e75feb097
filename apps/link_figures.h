// SPDX-License-Identifier: Apache-2.0
//
// What a drone's link has done so far, as its files and its status show it, and in words.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <set>
#include <string>

#include "apps/run_files.h"
#include "apps/run_summary.h"
#include "apps/start_doubt.h"
#include "comms/link.h"

namespace covey {

[[nodiscard]] LinkRecord link_record(TimeNs stamp_ns, const LinkStatistics& statistics,
                                     const PeerCounts& counts);

[[nodiscard]] LinkSummary link_summary(const LinkStatistics& statistics, const PeerCounts& counts);

// What status.json says of it. `there`: the peers that are.
[[nodiscard]] nlohmann::json link_status_json(const std::set<std::string>& there,
                                              const LinkStatistics& statistics,
                                              const PeerCounts& counts);

// Who of the expected peers is there, and why others were not heard, for people: one line.
[[nodiscard]] std::string words_on_peers(const std::set<std::string>& there, std::size_t expected,
                                         const LinkStatistics& statistics);

}  // namespace covey
