// SPDX-License-Identifier: Apache-2.0
#include "apps/json_file.h"

#include <fstream>
#include <stdexcept>

#include "apps/whole_file.h"

namespace covey {

nlohmann::json parse_json(std::istream& stream, const std::string& name) {
  try {
    return nlohmann::json::parse(stream);
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(name + ": not valid JSON: " + error.what());
  }
}

nlohmann::json read_json_file(const std::filesystem::path& file) {
  if (std::filesystem::is_directory(file))
    throw std::runtime_error(file.string() + ": cannot be read: it is a folder");
  std::ifstream stream(file);
  if (!stream) throw std::runtime_error(file.string() + ": cannot be read: is the path right?");
  return parse_json(stream, file.string());
}

void write_json_file(const std::filesystem::path& file, const nlohmann::json& json) {
  write_whole_file(file, json.dump(2) + '\n');
}

}  // namespace covey
