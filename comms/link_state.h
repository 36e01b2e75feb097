// SPDX-License-Identifier: Apache-2.0
//
// What a link knows and holds, apart from DDS itself: inbox, counts, peers. DDS threads put in, the
// caller's threads take out or wait; every member may be called from any thread, none calls out.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "comms/convert.h"
#include "comms/peer_link.h"
#include "comms/peer_table.h"

namespace covey {

enum class Kind : std::uint8_t { kRequest, kMessage, kFullMessage, kStatus, kOdometry };

// When who is missed.
struct TeamWatch {
  SilenceLimits silence;
  std::set<in_addr_t> others;  // where the team's other drones are, one at each; empty: not known
  int team_size = 0;           // with this one, where it is not known where they are; 0: not known
};

class LinkState {
 public:
  using Duration = std::chrono::milliseconds;
  using Time = PeerTable::Time;

  LinkState(std::string agent, std::size_t inbox_limit, const TeamWatch& watch = {},
            WallClock clock = wall_clock_ns);
  void set_own_id(const PeerId& id);

  // --- From DDS: what arrived, and who is there. What comes from this drone itself is ignored.
  void receive(Kind kind, const Bytes& bytes, const PeerId& from);
  void reject(const PeerId& from, const std::string& reason);
  void name_peer(const PeerId& id, const std::string& name);
  void change_matches(const PeerId& id, Channel channel, int difference, Time now);
  void enter_participant(const PeerId& id, Time now);  // drone or not
  void remove_participant(const PeerId& id);
  void hear(const Packet& packet, Time now);
  // Somebody is linked at each place of the team, whoever else is, or as many as it has, and nobody
  // has come lately: no participant needs to be told of this one.
  [[nodiscard]] bool complete(Time now) const;
  // For participants that may still get linked: who does not get on for 2 s is something else.
  struct Waiting {
    Time since = Time::max();  // the one that has waited longest came or got on
    int participants = 0;      // whether they wait or not
  };
  [[nodiscard]] Waiting waiting(Time now) const;

  // --- From the caller.
  std::vector<Inbound> take();
  [[nodiscard]] std::set<std::string> peers() const;
  [[nodiscard]] bool reaches(const std::string& receiver) const;
  [[nodiscard]] ArrivalCounts arrived() const;
  [[nodiscard]] LinkStatistics statistics() const;
  void count_sent(Kind kind, std::size_t bytes);
  void count_message_to(const std::string& receiver);
  void count_refused(Kind kind, const std::string& reason);

  using PeersTest = std::function<bool(const std::set<std::string>&)>;
  [[nodiscard]] bool wait_for_peers(const PeersTest& enough, Duration timeout);
  [[nodiscard]] bool wait_for_inbox(const ArrivalCounts& at_least, Duration timeout);

  // --- For the link's own thread: what follows from a change of who is there.
  struct Housekeeping {
    std::set<std::string> names;       // drones that may be answered
    std::vector<std::uint64_t> heard;  // tokens: when they change, the own status is due
    bool doubt = false;                // a peer is silent: it should be made to answer
  };
  // Blocks until something changed or the time has come; nothing once closed.
  [[nodiscard]] std::optional<Housekeeping> wait_for_housekeeping(Time until);
  // What the own status says of the peers, and the clock at this moment.
  [[nodiscard]] StatusSample to_be_said(const AgentStatus& status) const;
  void close();  // ends every wait

 private:
  [[nodiscard]] bool is_own(const PeerId& id) const;
  void receive_request(const Bytes& bytes, const PeerId& from);
  template <typename Message>
  void receive_message(Decoded<Message> decoded, std::size_t bytes, const PeerId& from);
  void receive_status(const Bytes& bytes, const PeerId& from);
  void compare_clocks(const StatusSample& sample, TimeNs received_ns);
  void accept(KindStatistics* kind, std::size_t bytes, Inbound inbound);
  void reject_locked(const PeerId& from, const std::string& reason);
  void change_peers(const std::function<void(PeerTable&)>& change);
  KindStatistics& statistics_of(Kind kind);

  const std::string agent_;
  const std::size_t inbox_limit_;
  const TeamWatch watch_;
  const WallClock clock_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  PeerId own_id_{};
  PeerTable table_;
  std::map<PeerId, Time> participants_;             // last progress; as many as DDS admits
  Time newcomer_;                                   // last packet of one that was not among them
  std::map<std::string, AgentStatus> last_status_;  // by drone
  std::map<std::string, ClockFilter> clocks_;       // the same
  std::deque<Inbound> inbox_;
  ArrivalCounts arrived_;
  LinkStatistics statistics_;
  bool peers_changed_ = false;
  bool closed_ = false;
};

}  // namespace covey
