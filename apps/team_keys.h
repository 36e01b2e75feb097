// SPDX-License-Identifier: Apache-2.0
//
// A team's keys on disk (comms/team_authority.h makes them):
//
//   DIR/uav0/            all that uav0 needs, and nothing else: copy it to the drone
//   DIR/team.authority/  keys that sign, and the certificates of all drones: for whoever runs the
//                        team; no drone needs it
//
// Nothing is left half-written: folders appear whole, files are replaced whole. All functions throw
// std::runtime_error that names the folder or drone and what to do.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "comms/access_rules.h"

namespace covey {

struct TeamKeysRequest {
  std::filesystem::path folder;
  std::vector<std::string> drones;
  int days = 365;  // from now; not for revocation
};

// `replace` an existing folder of keys, in which nothing else is; else it is refused.
void make_team_keys(const TeamKeysRequest& request, const std::string& team,
                    const DomainRange& domains, bool replace);

void add_team_keys(const TeamKeysRequest& request);

// Tells the folders of the others, and removes those of these drones.
void revoke_team_keys(const TeamKeysRequest& request);

}  // namespace covey
