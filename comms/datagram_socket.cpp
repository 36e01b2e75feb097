// SPDX-License-Identifier: Apache-2.0
#include "comms/datagram_socket.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace covey {
namespace {

constexpr timeval kPatience{0, 100'000};

// Without a port the system chooses a free one.
sockaddr_in endpoint(const std::string& address, std::uint16_t port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(port);
  if (!address.empty()) inet_pton(AF_INET, address.c_str(), &out.sin_addr);
  return out;
}

}  // namespace

DatagramSocket::DatagramSocket(const std::string& interface, std::size_t buffer_bytes)
    : interface_(interface), socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  const sockaddr_in own = endpoint(interface, 0);
  if (socket_ < 0 || bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof(own)) != 0) {
    const std::string why = std::strerror(errno);
    if (socket_ >= 0) close(socket_);
    throw std::runtime_error("link: no socket to send from " + interface + ": " + why);
  }
  const int bytes = static_cast<int>(buffer_bytes);  // the system gives what it allows
  setsockopt(socket_, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof(bytes));
  setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &kPatience, sizeof(kPatience));
}

DatagramSocket::~DatagramSocket() { close(socket_); }

bool DatagramSocket::send(const std::uint8_t* bytes, std::size_t size, const std::string& address,
                          std::uint16_t port) const {
  const sockaddr_in to = endpoint(address, port);
  const ssize_t sent =
      sendto(socket_, bytes, size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof(to));
  return sent == static_cast<ssize_t>(size);
}

void DatagramSocket::join(const std::string& group) const {
  ip_mreq request{};
  request.imr_multiaddr = endpoint(group, 0).sin_addr;
  request.imr_interface = endpoint(interface_, 0).sin_addr;
  if (setsockopt(socket_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof(request)) != 0)
    throw std::runtime_error("link: group " + group + " cannot be joined on " + interface_ + ": " +
                             std::strerror(errno));
}

}  // namespace covey
