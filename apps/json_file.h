// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <istream>
#include <nlohmann/json.hpp>
#include <string>

namespace covey {

// Ours has fewer levels. Who copies, compares or prints a value calls itself for each of them: a
// hundred thousand would overflow the stack.
inline constexpr int kMostJsonLevels = 32;

// Throws std::runtime_error that names the source, `name`, when it is not JSON, or has more levels.
[[nodiscard]] nlohmann::json parse_json(std::istream& stream, const std::string& name);

// Throws std::runtime_error that names the file when it cannot be read or is not JSON.
[[nodiscard]] nlohmann::json read_json_file(const std::filesystem::path& file);

// Bytes that are not UTF-8 become U+FFFD: what went wrong elsewhere may quote them. Indent -1: one
// line.
[[nodiscard]] inline std::string printable(const nlohmann::json& json, int indent = -1) {
  return json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

// Written beside and renamed: a reader sees the old file or the new one, never half of one.
void write_json_file(const std::filesystem::path& file, const nlohmann::json& json);

}  // namespace covey
