// SPDX-License-Identifier: Apache-2.0
#include "apps/control_channel.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "apps/json_file.h"

namespace covey {
namespace {

using Json = nlohmann::json;

Json to_json(const ArrivalCounts& counts) {
  return {{"requests", counts.requests}, {"messages", counts.messages}};
}

ArrivalCounts counts_from(const Json& json) {
  return {json.at("requests").get<std::uint64_t>(), json.at("messages").get<std::uint64_t>()};
}

Json message(const MeetCommand& c) {
  return {{"do", "meet"}, {"peers", c.peers}, {"patience_ms", c.patience_ms}};
}
Json message(const ReceiveCommand& c) {
  return {{"do", "receive"}, {"expected", to_json(c.expected)}, {"patience_ms", c.patience_ms}};
}
Json message(const AdvanceCommand& c) { return {{"do", "advance"}, {"until_ns", c.until_ns}}; }
Json message(const GoCommand& c) {
  return {{"do", "go"}, {"start_ms", c.start_ms}, {"first_ns", c.first_ns}};
}
Json message(const FinishCommand&) { return {{"do", "finish"}}; }

Json message(const ReadyReply& r) {
  return {{"is", "ready"},
          {"first_ns", r.first_ns},
          {"last_ns", r.last_ns},
          {"image_period_s", r.image_period_s}};
}
Json message(const MetReply& r) { return {{"is", "met"}, {"all", r.all}}; }
Json message(const ReceivedReply& r) {
  return {{"is", "received"}, {"arrived", to_json(r.arrived)}};
}
Json message(const AdvancedReply& r) {
  return {{"is", "advanced"},
          {"done", r.done},
          {"reached_ns", r.reached_ns},
          {"requests_sent", r.requests_sent},
          {"messages_sent_to", r.messages_sent_to},
          {"memory_mib", r.memory_mib}};
}
Json message(const FailedReply& r) { return {{"is", "failed"}, {"why", r.why}}; }

Command command_from(const Json& json) {
  const auto& kind = json.at("do").get_ref<const std::string&>();
  if (kind == "meet") {
    return MeetCommand{json.at("peers").get<std::vector<std::string>>(),
                       json.at("patience_ms").get<int>()};
  }
  if (kind == "receive") {
    return ReceiveCommand{counts_from(json.at("expected")), json.at("patience_ms").get<int>()};
  }
  if (kind == "advance") return AdvanceCommand{json.at("until_ns").get<TimeNs>()};
  if (kind == "go") {
    return GoCommand{json.at("start_ms").get<double>(), json.at("first_ns").get<TimeNs>()};
  }
  if (kind == "finish") return FinishCommand{};
  throw std::runtime_error("unknown command '" + kind + "'");
}

Reply reply_from(const Json& json) {
  const auto& kind = json.at("is").get_ref<const std::string&>();
  if (kind == "ready") {
    return ReadyReply{json.at("first_ns").get<TimeNs>(), json.at("last_ns").get<TimeNs>(),
                      json.at("image_period_s").get<double>()};
  }
  if (kind == "met") return MetReply{json.at("all").get<bool>()};
  if (kind == "received") return ReceivedReply{counts_from(json.at("arrived"))};
  if (kind == "advanced") {
    return AdvancedReply{json.at("done").get<bool>(), json.at("reached_ns").get<TimeNs>(),
                         json.at("requests_sent").get<std::uint64_t>(),
                         json.at("messages_sent_to").get<std::map<std::string, std::uint64_t>>(),
                         json.at("memory_mib").get<double>()};
  }
  if (kind == "failed") return FailedReply{json.at("why").get<std::string>()};
  throw std::runtime_error("unknown reply '" + kind + "'");
}

template <typename Result>
Result decode(const std::string& line, Result (*from)(const Json&)) {
  try {
    return from(Json::parse(line));
  } catch (const std::exception& error) {
    throw std::runtime_error("the control channel carries something else: " +
                             std::string(error.what()));
  }
}

}  // namespace

std::string encode(const Command& command) {
  return std::visit([](const auto& c) { return printable(message(c)); }, command);
}

std::string encode(const Reply& reply) {
  return std::visit([](const auto& r) { return printable(message(r)); }, reply);
}

Command decode_command(const std::string& line) { return decode<Command>(line, command_from); }
Reply decode_reply(const std::string& line) { return decode<Reply>(line, reply_from); }

LineChannel::~LineChannel() {
  if (fd_ >= 0) close(fd_);
}

LineChannel::LineChannel(LineChannel&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      buffer_(std::move(other.buffer_)),
      end_of_file_(other.end_of_file_) {}

bool LineChannel::send(const std::string& line) {
  const std::string whole = line + "\n";
  std::size_t sent = 0;
  while (sent < whole.size()) {
    const ssize_t n = ::send(fd_, whole.data() + sent, whole.size() - sent, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return false;
    sent += static_cast<std::size_t>(n);
  }
  return true;
}

std::optional<std::string> LineChannel::take_line() {
  std::size_t end = buffer_.find('\n');
  if (end == std::string::npos) {
    read_available();
    end = buffer_.find('\n');
    if (end == std::string::npos) return std::nullopt;
  }
  std::string line = buffer_.substr(0, end);
  buffer_.erase(0, end + 1);
  return line;
}

bool LineChannel::closed() {
  read_available();
  return end_of_file_ && buffer_.find('\n') == std::string::npos;
}

void LineChannel::read_available() {
  char chunk[4096];
  while (!end_of_file_) {
    const ssize_t n = recv(fd_, chunk, sizeof(chunk), MSG_DONTWAIT);
    if (n > 0) {
      buffer_.append(chunk, static_cast<std::size_t>(n));
    } else if (n < 0 && errno == EINTR) {
      continue;
    } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      return;
    } else {
      end_of_file_ = true;
    }
  }
}

void LineChannel::wait(const std::vector<const LineChannel*>& channels,
                       std::chrono::milliseconds timeout) {
  std::vector<pollfd> descriptors;
  for (const LineChannel* channel : channels) {
    if (!channel->end_of_file_) descriptors.push_back({channel->fd_, POLLIN, 0});
  }
  poll(descriptors.data(), descriptors.size(), static_cast<int>(timeout.count()));
}

}  // namespace covey
