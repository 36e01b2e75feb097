// SPDX-License-Identifier: Apache-2.0
#include "comms/datagram_socket.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <stdexcept>
#include <vector>

namespace covey {
namespace {

// On a free port of 127.0.0.1.
class Receiver {
 public:
  Receiver() : socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    own_.sin_family = AF_INET;
    own_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(own_);
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&own_), size), 0);
    EXPECT_EQ(getsockname(socket_, reinterpret_cast<sockaddr*>(&own_), &size), 0);
  }
  ~Receiver() { close(socket_); }
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  [[nodiscard]] std::uint16_t port() const { return ntohs(own_.sin_port); }
  [[nodiscard]] std::vector<std::uint8_t> next() const {
    std::vector<std::uint8_t> out(100);
    const ssize_t size = recv(socket_, out.data(), out.size(), 0);
    out.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
    return out;
  }

 private:
  int socket_;
  sockaddr_in own_{};
};

TEST(DatagramSocket, WhatIsSentArrivesAsItIs) {
  const Receiver receiver;
  const DatagramSocket sender("127.0.0.1", 65536), from_anywhere("", 65536);
  const std::vector<std::uint8_t> bytes = {1, 2, 3, 0, 255};
  EXPECT_TRUE(sender.send(bytes.data(), bytes.size(), "127.0.0.1", receiver.port()));
  EXPECT_EQ(receiver.next(), bytes);
  EXPECT_TRUE(from_anywhere.send(bytes.data(), 3, "127.0.0.1", receiver.port()));
  EXPECT_EQ(receiver.next(), (std::vector<std::uint8_t>{1, 2, 3}));
}

TEST(DatagramSocket, FromLoopbackNothingLeavesTheMachine) {
  const DatagramSocket sender("127.0.0.1", 65536);
  const std::uint8_t byte = 0;
  EXPECT_FALSE(sender.send(&byte, 1, "192.0.2.1", 9));  // never assigned (RFC 5737)
}

TEST(DatagramSocket, AnAddressThatIsNotOursIsRefused) {
  try {
    const DatagramSocket sender("192.0.2.1", 65536);
    FAIL() << "should have thrown";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::StartsWith("link: no socket to send from 192.0.2.1: "));
  }
}

}  // namespace
}  // namespace covey
