// SPDX-License-Identifier: Apache-2.0
//
// An outsider with a UDP socket: hears the names (GUID prefixes) by which drones announce
// themselves, which nothing hides, and says things in their name.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <set>
#include <stdexcept>
#include <vector>

#include "comms/convert.h"
#include "comms/peer_link.h"

namespace covey {

class EavesdroppingForger {
 public:
  using Prefix = std::array<std::uint8_t, 12>;

  explicit EavesdroppingForger(const LinkConfig& team)
      : first_port_(7410 + 250 * team.domain), socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    const timeval patience{60, 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    // Where drones look for a fifth one of this machine.
    const sockaddr_in own = address(first_port_ + 2 * 4);
    if (bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0)
      throw std::runtime_error("forger: its port is taken");
  }
  ~EavesdroppingForger() { close(socket_); }
  EavesdroppingForger(const EavesdroppingForger&) = delete;
  EavesdroppingForger& operator=(const EavesdroppingForger&) = delete;

  // Waits for one that was not heard before.
  Prefix hear_prefix() {
    for (;;) {
      std::array<std::uint8_t, 65536> packet{};
      const ssize_t size = recv(socket_, packet.data(), packet.size(), 0);
      if (size < 20) throw std::runtime_error("forger: heard nothing");
      Prefix prefix{};
      std::copy_n(packet.begin() + 8, prefix.size(), prefix.begin());
      if (heard_.insert(prefix).second) return prefix;
    }
  }

  // In the name of a drone that was not heard before, by each writer that it may have, to all
  // drones.
  void send_as_every_other(const Bytes& sample) {
    const Prefix prefix = hear_prefix();
    for (std::uint8_t writer = 0; writer < 16; ++writer)
      for (int drone = 0; drone < 4; ++drone)
        send_data(forged_packet(prefix, writer, sample), first_port_ + 2 * drone + 1);
  }

 private:
  static sockaddr_in address(int port) {
    sockaddr_in out{};
    out.sin_family = AF_INET;
    out.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    out.sin_port = htons(static_cast<std::uint16_t>(port));
    return out;
  }

  // Its first sample as one DATA submessage (RTPS 2.3, 9.4.5.3), to whichever reader it has.
  static Bytes forged_packet(const Prefix& prefix, std::uint8_t writer, const Bytes& sample) {
    Bytes packet = {'R', 'T', 'P', 'S', 2, 3, 1, 0x0f};
    packet.insert(packet.end(), prefix.begin(), prefix.end());
    const std::size_t length = 20 + sample.size();
    const Bytes head = {0x15,
                        0x05,  // little-endian, with data
                        static_cast<std::uint8_t>(length & 0xff),
                        static_cast<std::uint8_t>(length >> 8),
                        0,
                        0,
                        16,
                        0,  // octets to the inline QoS
                        0,
                        0,
                        0,
                        0,  // any reader
                        0,
                        0,
                        writer,
                        0x03,  // a writer without key
                        0,
                        0,
                        0,
                        0,
                        1,
                        0,
                        0,
                        0};
    packet.insert(packet.end(), head.begin(), head.end());
    packet.insert(packet.end(), sample.begin(), sample.end());
    return packet;
  }

  void send_data(const Bytes& packet, int port) const {
    const sockaddr_in to = address(port);
    const ssize_t sent = sendto(socket_, packet.data(), packet.size(), 0,
                                reinterpret_cast<const sockaddr*>(&to), sizeof to);
    if (sent != static_cast<ssize_t>(packet.size())) throw std::runtime_error("forger: not sent");
  }

  const int first_port_, socket_;
  std::set<Prefix> heard_;
};

}  // namespace covey
