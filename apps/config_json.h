// SPDX-License-Identifier: Apache-2.0
//
// JSON to settings and back, for whatever shows its keys to a visitor.
#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "apps/config_visitor.h"

namespace covey {

using ShowsKeys = std::function<void(ConfigVisitor&)>;

// Sets what `json` holds; `where` is named in errors. An unknown key, or a value of another type or
// out of range, is a std::runtime_error.
void set_from_json(const nlohmann::json& json, const std::string& where, const ShowsKeys& settings);

[[nodiscard]] nlohmann::ordered_json to_ordered_json(const ShowsKeys& settings);

[[nodiscard]] std::string range_text(Range range);
[[nodiscard]] std::string join(const std::vector<std::string>& words, const std::string& separator);

}  // namespace covey
