// SPDX-License-Identifier: Apache-2.0
//
// Sends UDP datagrams as they are given. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace covey {

class DatagramSocket {
 public:
  // From that IPv4 address of this machine, or from any one if it is empty. Throws
  // std::runtime_error that says what the system refused.
  DatagramSocket(const std::string& interface, std::size_t buffer_bytes);
  ~DatagramSocket();
  DatagramSocket(const DatagramSocket&) = delete;
  DatagramSocket& operator=(const DatagramSocket&) = delete;

  // False if the system did not take it; it waits a tenth of a second for room.
  bool send(const std::uint8_t* bytes, std::size_t size, const std::string& address,
            std::uint16_t port) const;

  // The group's packets come in on that interface from now on, for whoever listens to its port on
  // all of them. Throws as the constructor does.
  void join(const std::string& group) const;

 private:
  const std::string interface_;
  int socket_ = -1;
};

}  // namespace covey
