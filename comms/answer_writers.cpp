// SPDX-License-Identifier: Apache-2.0
#include "comms/answer_writers.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "comms/link_topics.h"

namespace covey {

AnswerWriters::AnswerWriters(const LinkConfig& config, LinkState& state, LinkEntities& entities)
    : config_(config), message_kind_(message_kind(config)), state_(state), entities_(entities) {}

// Holds the lock from creation to entry: a writer may be matched, and be asked for, in between.
void AnswerWriters::create_for(const std::set<std::string>& names) {
  const std::lock_guard lock(mutex_);
  std::set<std::string> turned_away;
  for (const std::string& name : names) {
    if (name == config_.agent || writers_.count(name) > 0) continue;
    if (!make_room(names)) {
      turned_away.insert(name);
      continue;
    }
    try {
      writers_[name] = entities_.create_answer_writer(name);
    } catch (const std::exception&) {
      state_.count_refused(message_kind_, "no answer topic for a peer: out of memory");
    }
  }
  count_turned_away(std::move(turned_away));
}

// With the map locked. Others take a writer under this lock and hold on to it while they use it, so
// that one that is only in the map is used by nobody.
bool AnswerWriters::make_room(const std::set<std::string>& names) {
  if (writers_.size() + 1 < static_cast<std::size_t>(config_.max_agents)) return true;
  const auto unused = std::find_if(writers_.begin(), writers_.end(), [&](const auto& entry) {
    return names.count(entry.first) == 0 && entry.second.use_count() == 1;
  });
  if (unused == writers_.end()) return false;
  writers_.erase(unused);
  return true;
}

// Each once, until it has left or got its topic.
void AnswerWriters::count_turned_away(std::set<std::string> names) {
  for (const std::string& name : names)
    if (turned_away_.count(name) == 0) state_.count_refused(message_kind_, kCrowd);
  turned_away_ = std::move(names);
}

AnswerWriters::Writer AnswerWriters::writer_to(const std::string& receiver) const {
  const std::lock_guard lock(mutex_);
  const auto found = writers_.find(receiver);
  return found == writers_.end() ? nullptr : found->second;
}

std::vector<AnswerWriters::Writer> AnswerWriters::all() const {
  const std::lock_guard lock(mutex_);
  std::vector<Writer> out;
  for (const auto& entry : writers_) out.push_back(entry.second);
  return out;
}

std::set<std::string> AnswerWriters::receivers() const {
  const std::lock_guard lock(mutex_);
  std::set<std::string> names;
  for (const auto& [name, writer] : writers_)
    if (state_.reaches(name)) names.insert(name);
  return names;
}

}  // namespace covey
