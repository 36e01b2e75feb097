// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "apps/config_file.h"
#include "frontend/place_recognition.h"

namespace covey {

// "visual" or "thermal" for those compiled into the program, anything else is the path of a file
// that `covey train-vocabulary` wrote. Throws std::runtime_error naming the file and what is wrong.
[[nodiscard]] Vocabulary load_vocabulary(const std::string& name_or_path);

// What a drone with these settings tells places by. Throws std::runtime_error too when a question
// with so many words does not fit into a message: every link would refuse it.
[[nodiscard]] Vocabulary vocabulary_of(const AgentConfig& config, bool named_thermal);

// Throws std::runtime_error when the file cannot be written whole; then it is as it was before.
void write_vocabulary(const std::filesystem::path& file, const Vocabulary& vocabulary);

}  // namespace covey
