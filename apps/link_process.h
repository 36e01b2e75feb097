// SPDX-License-Identifier: Apache-2.0
//
// A link in a process of its own (link_worker.h), so that whatever happens to DDS does not happen
// to the drone: a crash, a hang, growing memory. No member waits for that process but close(), the
// constructor and those that say so. A process that has ended, that does not report, that uses
// more than link.max_memory_mib or that says what it cannot mean is killed and started anew; other
// drones meet it as they meet a drone that comes back. Its statistics go on counting, but for the
// last tenth of a second of each life.
#pragma once

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "apps/child_process.h"
#include "apps/config_file.h"
#include "apps/record_channel.h"
#include "comms/link.h"
#include "comms/link_state.h"

namespace covey {

// How soon a process is started anew, and how long its start may take. One that cannot live, or
// not start so soon, shall not take the drone's processor.
class RestartPolicy {
 public:
  using Duration = std::chrono::milliseconds;

  // Not at all after a life worth its name, then longer and longer.
  [[nodiscard]] Duration pause_after(Duration life);
  // Longer after every start that took too long.
  [[nodiscard]] Duration start_patience() const { return start_patience_; }
  void started_in_time(bool in_time);

 private:
  static constexpr Duration kFirstPatience{2000};
  Duration pause_{0};
  Duration start_patience_ = kFirstPatience;
};

class LinkProcess : public Link {
 public:
  // Starts it and waits until it is on the air. Throws std::runtime_error if it cannot be.
  explicit LinkProcess(const AgentConfig& config);
  ~LinkProcess() override;  // after close()
  LinkProcess(const LinkProcess&) = delete;
  LinkProcess& operator=(const LinkProcess&) = delete;

  // True: handed on, if its process lives so long. False: refused or dropped, and counted.
  bool send(const PlaceAdvert& advert) override;
  bool send(const PeerKeyframe& keyframe) override;
  bool send(const FullPeerKeyframe& message) override;
  bool publish(const Odometry& odometry) override;
  bool publish(const AgentStatus& status) override;

  [[nodiscard]] std::vector<Inbound> take() override { return state_.take(); }
  [[nodiscard]] std::set<std::string> peers() const override;
  [[nodiscard]] bool wait_for_peers(const std::set<std::string>& names,
                                    std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool wait_for_peers(std::size_t count, std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool wait_for_inbox(const ArrivalCounts& at_least,
                                    std::chrono::milliseconds timeout) override;
  [[nodiscard]] ArrivalCounts arrived() const override { return state_.arrived(); }
  void close() override;
  [[nodiscard]] LinkStatistics statistics() const override;

 private:
  struct Life;
  // How a life ended.
  struct End {
    std::string reason;  // of a fixed set: reasons are counted; empty: it was asked to end
    std::string words;   // its own, where it had any
  };

  template <typename Message>
  bool offer(Kind kind, const Message& message);
  bool offer(Kind kind, const Bytes& sample);
  template <typename Test>
  bool wait_until(const Test& enough, std::chrono::milliseconds timeout);
  void wait_until_on_the_air();

  // On the supervisor's thread.
  void supervise();
  [[nodiscard]] End live(RestartPolicy& policy);
  [[nodiscard]] End watch(Life& life);
  [[nodiscard]] std::optional<End> take_records(Life& life);
  [[nodiscard]] std::optional<End> take(const Record& record, Life& life);
  [[nodiscard]] std::optional<End> take_report(const Bytes& content, Life& life);
  void end_in_good_order(Life& life);
  [[nodiscard]] bool bury(const End& end);
  [[nodiscard]] bool closing() const;

  const LinkConfig config_;
  const Bytes settings_;
  LinkState state_;  // inbox, and what was refused on this side

  mutable std::mutex mutex_;  // of what follows, up to the thread
  std::condition_variable changed_;
  RecordChannel* channel_ = nullptr;  // of a process that is on the air
  bool closing_ = false;
  bool was_on_the_air_ = false;
  std::optional<std::string> complaint_;  // of a process that ended before any was
  std::set<std::string> peers_;
  LinkStatistics before_, now_;  // of lives that have ended, of the present one
  std::uint64_t own_kib_ = 0;    // memory of the present one

  std::thread supervisor_;
};

}  // namespace covey
