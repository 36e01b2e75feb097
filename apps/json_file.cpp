// SPDX-License-Identifier: Apache-2.0
#include "apps/json_file.h"

#include <fstream>
#include <stdexcept>

#include "apps/whole_file.h"

namespace covey {

nlohmann::json read_json_file(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) throw std::runtime_error(file.string() + ": cannot be read: is the path right?");
  try {
    return nlohmann::json::parse(stream);
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(file.string() + ": not valid JSON: " + error.what());
  }
}

void write_json_file(const std::filesystem::path& file, const nlohmann::json& json) {
  write_whole_file(file, json.dump(2) + '\n');
}

}  // namespace covey
