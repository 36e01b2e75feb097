// SPDX-License-Identifier: Apache-2.0
#include "apps/vocabulary_file.h"

#include <fstream>
#include <iterator>
#include <stdexcept>

#include "apps/whole_file.h"
#include "frontend/vocabulary_thermal.h"
#include "frontend/vocabulary_visual.h"

namespace covey {

Vocabulary load_vocabulary(const std::string& name_or_path) {
  if (name_or_path == "visual") return visual_vocabulary();
  if (name_or_path == "thermal") return thermal_vocabulary();
  std::ifstream stream(name_or_path, std::ios::binary);
  if (!std::filesystem::is_regular_file(name_or_path) || !stream) {
    throw std::runtime_error("vocabulary '" + name_or_path +
                             "': cannot be read: give visual, thermal, or the path of a file");
  }
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  try {
    return parse_vocabulary(text);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(name_or_path + ": " + error.what());
  }
}

void write_vocabulary(const std::filesystem::path& file, const Vocabulary& vocabulary) {
  write_whole_file(file, to_text(vocabulary));
}

}  // namespace covey
