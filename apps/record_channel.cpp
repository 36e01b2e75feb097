// SPDX-License-Identifier: Apache-2.0
#include "apps/record_channel.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <cstdint>

namespace covey {
namespace {

using std::chrono::steady_clock;

constexpr std::size_t kChunkBytes = 65536;

bool would_wait(ssize_t result) {
  return result < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
}

}  // namespace

RecordChannel::RecordChannel(int socket)
    : socket_(socket), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

bool RecordChannel::offer(RecordKind kind, const Bytes& content) {
  {
    const std::lock_guard lock(mutex_);
    if (!writer_.offer(kind, content)) return false;
  }
  wake();
  return true;
}

void RecordChannel::wake() const { (void)eventfd_write(wake_.get(), 1); }

bool RecordChannel::anything_waits() const {
  const std::lock_guard lock(mutex_);
  return writer_.size() > 0;
}

bool RecordChannel::exchange(std::chrono::milliseconds timeout) {
  const short events = anything_waits() ? POLLIN | POLLOUT : POLLIN;
  std::array<pollfd, 2> ends = {{{socket_, events, 0}, {wake_.get(), POLLIN, 0}}};
  if (poll(ends.data(), ends.size(), static_cast<int>(timeout.count())) <= 0) return open_;
  eventfd_t woken = 0;
  (void)eventfd_read(wake_.get(), &woken);
  send_some();
  if (ends[0].revents != 0) receive_some();
  return open_;
}

void RecordChannel::send_some() {
  const std::lock_guard lock(mutex_);
  while (writer_.size() > 0) {
    const ssize_t sent = send(socket_, writer_.data(), writer_.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (would_wait(sent)) return;
    // Nobody there any more: what was said before can still be received.
    writer_.drop(sent < 0 ? writer_.size() : static_cast<std::size_t>(sent));
  }
}

// One chunk: who says much does not keep us from everything else.
void RecordChannel::receive_some() {
  std::array<std::uint8_t, kChunkBytes> chunk{};
  const ssize_t received = recv(socket_, chunk.data(), chunk.size(), MSG_DONTWAIT);
  if (would_wait(received)) return;
  if (received > 0)
    reader_.append(chunk.data(), static_cast<std::size_t>(received));
  else
    open_ = false;
}

bool RecordChannel::finish(std::chrono::milliseconds patience) {
  const auto deadline = steady_clock::now() + patience;
  pollfd end = {socket_, POLLOUT, 0};
  send_some();
  while (open_ && anything_waits() && steady_clock::now() < deadline) {
    poll(&end, 1, 10);
    send_some();
  }
  shutdown(socket_, SHUT_WR);
  return !anything_waits();
}

}  // namespace covey
