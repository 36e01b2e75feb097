// SPDX-License-Identifier: Apache-2.0
//
// Named profiles of the link (comms/link_profile.h), as JSON: those of the program, which are part
// of it (comms/link_profiles.json), or those of a file of one's own. A profile holds the values
// that differ from the one it is made `from`; a section's `why` holds the reason of each.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "apps/config_visitor.h"
#include "comms/link_profile.h"

namespace covey {

struct ProfileChoice {
  std::string name = "lossy_wifi";
  std::string file;                              // empty: the program's
  std::map<std::string, std::string> overrides;  // JSON by "section.key"
};

// Shows every key of `profile` to `visitor`.
void visit_profile(LinkProfile& profile, ConfigVisitor& visitor);

// `where` names the source of the choice in errors, which are std::runtime_error: an unknown name
// or key, or a value that cannot work.
[[nodiscard]] LinkProfile read_profile(const ProfileChoice& choice, const std::string& where);

struct ProfileName {
  std::string name, why;
};
[[nodiscard]] std::vector<ProfileName> profile_names(const std::string& file);

// All values, each beside its reason: {"section": {"key": {"value": 1, "why": "..."}}}.
[[nodiscard]] nlohmann::ordered_json profile_with_reasons(const ProfileChoice& choice,
                                                          const std::string& where);

}  // namespace covey
