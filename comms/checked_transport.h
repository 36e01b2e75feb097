// SPDX-License-Identifier: Apache-2.0
//
// Passes everything on as it is, but for malformed packets that arrive (rtps_check.h): those are
// counted and go no further. It can keep what is said on this computer as well: then packets of
// others are left out, and nothing is sent to them.
//
//   Programs of this computer say where they listen by the address of any of its interfaces, and
//     those who speak Cyclone DDS look at nobody's 127.0.0.1 but on that interface. So a socket
//     hears all interfaces, and what has come from elsewhere is dropped here: Linux lets nothing in
//     from a network that claims to be of this computer.
//   All is sent from 127.0.0.1, from where nothing leaves, and multicast over the loopback alone.
//     Linux carries it to all who listen to a group there, once anybody has joined it there.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <atomic>
#include <cstdint>
#include <memory>

namespace covey {

using PacketCount = std::atomic<std::uint64_t>;

inline constexpr char kDiscoveryGroup[] = "239.255.0.1";  // of all domains, by multicast

enum class Reach { kEverybody, kThisComputer };

struct CheckedTransportDescriptor : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  CheckedTransportDescriptor(
      std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
      std::shared_ptr<PacketCount> malformed, Reach reach);
  eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  std::shared_ptr<PacketCount> malformed;  // shared with the transports, which outlive their maker
  Reach reach = Reach::kEverybody;
};

}  // namespace covey
