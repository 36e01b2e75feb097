// SPDX-License-Identifier: Apache-2.0
#include "comms/dispatcher.h"

#include <chrono>
#include <utility>

namespace covey {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

Dispatcher::Dispatcher(const LoadProfile& load, Radio radio)
    : radio_(std::move(radio)), outbox_(load) {
  if (!outbox_.unlimited()) thread_ = std::thread([this] { keep_sending(); });
}

Dispatcher::~Dispatcher() { close(); }

void Dispatcher::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

bool Dispatcher::send(Outgoing out) {
  if (outbox_.unlimited()) return radio_.send(std::move(out));
  {
    const std::lock_guard lock(mutex_);
    outbox_.offer(std::move(out), steady_clock::now());
    send_what_may_go();
  }
  changed_.notify_one();
  return true;
}

// With the outbox locked.
void Dispatcher::send_what_may_go() {
  const Audience audience = radio_.audience();
  while (auto out = outbox_.next(radio_.wire_bytes(), audience, steady_clock::now()))
    radio_.send(*std::move(out));
}

void Dispatcher::keep_sending() {
  constexpr milliseconds kRoomPoll{10};
  std::unique_lock lock(mutex_);
  while (!closed_) {
    if (outbox_.empty())
      changed_.wait(lock, [this] { return closed_ || !outbox_.empty(); });
    else
      changed_.wait_for(lock, kRoomPoll, [this] { return closed_; });
    if (!closed_) send_what_may_go();
  }
}

std::map<std::string, std::uint64_t> Dispatcher::dropped() const {
  const std::lock_guard lock(mutex_);
  return outbox_.dropped();
}

}  // namespace covey
