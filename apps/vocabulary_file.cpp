// SPDX-License-Identifier: Apache-2.0
#include "apps/vocabulary_file.h"

#include <fstream>
#include <iterator>
#include <stdexcept>

#include "apps/whole_file.h"
#include "comms/checks.h"
#include "frontend/vocabulary_thermal.h"
#include "frontend/vocabulary_visual.h"

namespace covey {
namespace {

// Naive drones ask nothing, and compact corners need no words.
bool words_are_sent(const CollaboratorConfig& config) {
  if (config.exchange == ExchangeMode::kCompact) return config.place_mode != PlaceMode::kCompact;
  return config.exchange == ExchangeMode::kPaper;
}

}  // namespace

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

Vocabulary vocabulary_of(const AgentConfig& config, bool named_thermal) {
  constexpr std::size_t kMostWords = kMaxDescriptorBytes / sizeof(BinaryDescriptor);
  std::string name = config.agent.vocabulary;
  if (name.empty()) {
    name = is_thermal_camera(config.thermal.mode, named_thermal) ? "thermal" : "visual";
  }
  Vocabulary vocabulary = load_vocabulary(name);
  const std::size_t words = vocabulary.words.size();
  if (words_are_sent(config.collaboration) && words > kMostWords) {
    throw std::runtime_error("agent.vocabulary '" + name + "': " + std::to_string(words) +
                             " words, but a question has room for " + std::to_string(kMostWords) +
                             ": train fewer (--words), or set place_mode and exchange to compact");
  }
  return vocabulary;
}

void write_vocabulary(const std::filesystem::path& file, const Vocabulary& vocabulary) {
  write_whole_file(file, to_text(vocabulary));
}

}  // namespace covey
