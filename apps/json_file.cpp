// SPDX-License-Identifier: Apache-2.0
#include "apps/json_file.h"

#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/whole_file.h"

namespace covey {

namespace {

// Of two values of one key the first would be lost without a word.
class UniqueKeysOnFewLevels {
 public:
  explicit UniqueKeysOnFewLevels(std::string name) : name_(std::move(name)) {}

  bool operator()(int depth, nlohmann::json::parse_event_t event, nlohmann::json& parsed) {
    using Event = nlohmann::json::parse_event_t;
    if (depth > kMostJsonLevels)
      throw std::runtime_error(name_ + ": nested deeper than " + std::to_string(kMostJsonLevels) +
                               " levels: that is none of Covey's files");
    if (event == Event::object_start) open_objects_.emplace_back();
    if (event == Event::object_end) open_objects_.pop_back();
    if (event == Event::key && !open_objects_.back().insert(parsed.get<std::string>()).second)
      throw std::runtime_error(name_ + ": key " + parsed.dump() + " stands twice in one object");
    return true;
  }

 private:
  std::string name_;
  std::vector<std::set<std::string>> open_objects_;
};

}  // namespace

nlohmann::json parse_json(std::istream& stream, const std::string& name) {
  try {
    return nlohmann::json::parse(stream, UniqueKeysOnFewLevels(name));
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(name + ": not valid JSON: " + error.what());
  }
}

nlohmann::json read_json_file(const std::filesystem::path& file) {
  std::istringstream stream(read_whole_file(file));
  return parse_json(stream, file.string());
}

void write_json_file(const std::filesystem::path& file, const nlohmann::json& json) {
  write_whole_file(file, printable(json, 2) + '\n');
}

}  // namespace covey
