// SPDX-License-Identifier: Apache-2.0
#include "apps/status_file.h"

#include <spdlog/spdlog.h>

#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "apps/json_file.h"
#include "apps/process_usage.h"

namespace covey {

StatusFile::StatusFile(std::filesystem::path file) : file_(std::move(file)) {
  write({{"frames", 0}}, steady_ms());
}

bool StatusFile::due(double now_ms) const {
  constexpr double kInterval_ms = 1000;
  return now_ms - written_ms_ >= kInterval_ms;
}

void StatusFile::write(const nlohmann::json& status, double now_ms) {
  written_ms_ = now_ms;
  try {
    write_json_file(file_, status);
  } catch (const std::exception& error) {
    if (!warned_) spdlog::warn("{} Flying on without it.", error.what());
    warned_ = true;
  }
}

}  // namespace covey
