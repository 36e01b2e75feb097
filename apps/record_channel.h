// SPDX-License-Identifier: Apache-2.0
//
// Records (link_record.h) over a socket, without ever waiting for the other end. Any thread may
// offer; all the rest is one thread's.
#pragma once

#include <chrono>
#include <mutex>
#include <optional>

#include "apps/file_descriptor.h"
#include "apps/link_record.h"

namespace covey {

class RecordChannel {
 public:
  explicit RecordChannel(int socket);  // whose owner outlives this

  // False: no room, the other end does not read; the record is lost.
  bool offer(RecordKind kind, const Bytes& content);

  // Moves bytes both ways until something has happened or the time is up. False: the other end
  // has said its last; what it said can still be taken.
  [[nodiscard]] bool exchange(std::chrono::milliseconds timeout);
  // Ends the exchange() that waits, or else the next one.
  void wake() const;

  [[nodiscard]] std::optional<Decoded<Record>> next() { return reader_.next(); }

  // Sends what is waiting, for up to so long, and then says the last word. False: not all went.
  bool finish(std::chrono::milliseconds patience);

 private:
  [[nodiscard]] bool anything_waits() const;
  void send_some();
  void receive_some();

  const int socket_;
  const FileDescriptor wake_;
  mutable std::mutex mutex_;  // of the writer
  RecordWriter writer_;
  RecordReader reader_;
  bool open_ = true;
};

}  // namespace covey
