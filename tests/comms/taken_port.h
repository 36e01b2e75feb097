// SPDX-License-Identifier: Apache-2.0
//
// Another program, which has a UDP port of 127.0.0.1 as long as this lives.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>

namespace covey {

class TakenPort {
 public:
  explicit TakenPort(int port) : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in own{};
    own.sin_family = AF_INET;
    own.sin_port = htons(static_cast<std::uint16_t>(port));
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    taken_ = bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof(own)) == 0;
  }
  ~TakenPort() { close(socket_); }
  TakenPort(const TakenPort&) = delete;
  TakenPort& operator=(const TakenPort&) = delete;

  [[nodiscard]] bool taken() const { return taken_; }

 private:
  int socket_;
  bool taken_ = false;
};

}  // namespace covey
