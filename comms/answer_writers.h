// SPDX-License-Identifier: Apache-2.0
//
// What a drone answers with: a DDS writer for each peer, of a topic that nobody else reads. Who has
// left keeps its writer until another one needs the room: it may come back. All but create_for()
// may be called from any thread. Inside this room only.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "comms/link_entities.h"
#include "comms/link_state.h"
#include "comms/peer_link.h"

namespace covey {

class AnswerWriters {
 public:
  using Writer = std::shared_ptr<LinkEntities::Writer>;

  // All three must outlive it: its writers end before their publisher.
  AnswerWriters(const LinkConfig& config, LinkState& state, LinkEntities& entities);

  // For those of them who have none yet; they are all who may be answered now. The housekeeper's.
  void create_for(const std::set<std::string>& names);

  // Hold on to a writer while it is used.
  [[nodiscard]] Writer writer_to(const std::string& receiver) const;  // nothing: there is none
  [[nodiscard]] std::vector<Writer> all() const;
  [[nodiscard]] std::set<std::string> receivers() const;  // who has a writer and is there

 private:
  bool make_room(const std::set<std::string>& names);
  void count_turned_away(std::set<std::string> names);

  const LinkConfig& config_;
  const Kind message_kind_;
  LinkState& state_;
  LinkEntities& entities_;

  mutable std::mutex mutex_;  // guards the map, not the writers
  std::map<std::string, Writer> writers_;

  // The housekeeper's.
  std::set<std::string> turned_away_;  // who is there and has no answer topic for want of room
};

}  // namespace covey
