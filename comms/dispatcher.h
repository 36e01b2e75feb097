// SPDX-License-Identifier: Apache-2.0
//
// Sends what a drone wants to say: at once where its profile does not limit the load, otherwise as
// its outbox lets it go, on the caller's thread if there is room and later on one of its own.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>

#include "comms/link_profile.h"
#include "comms/outbox.h"

namespace covey {

class Dispatcher {
 public:
  // Called from any thread, and with the outbox locked: they must not come back here.
  struct Radio {
    std::function<bool(Outgoing)> send;         // false: not sent
    std::function<std::uint64_t()> wire_bytes;  // all that the drone has sent so far
    std::function<Audience()> audience;
  };

  Dispatcher(const LoadProfile& load, Radio radio);
  ~Dispatcher();
  Dispatcher(const Dispatcher&) = delete;
  Dispatcher& operator=(const Dispatcher&) = delete;

  bool send(Outgoing out);  // true also if it waits
  void close();             // what waits stays unsent

  [[nodiscard]] std::map<std::string, std::uint64_t> dropped() const;  // as the outbox counts

 private:
  void send_what_may_go();
  void keep_sending();

  const Radio radio_;

  // Whoever holds the lock writes what comes out.
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Outbox outbox_;
  bool closed_ = false;

  std::thread thread_;
};

}  // namespace covey
