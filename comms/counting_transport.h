// SPDX-License-Identifier: Apache-2.0
//
// Counts what really goes over the wire: every packet of this process, with discovery, heartbeats
// and repair, from the IPv4 header on. It passes everything on, but for malformed packets that
// arrive (rtps_check.h): those go no further.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <atomic>
#include <cstdint>
#include <memory>

namespace covey {

struct WireCounters {
  std::atomic<std::uint64_t> bytes_sent{0};
  std::atomic<std::uint64_t> bytes_received{0};
  std::atomic<std::uint64_t> malformed_received{0};  // packets
};

struct CountingTransportDescriptor : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  CountingTransportDescriptor(
      std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
      std::shared_ptr<WireCounters> counters);
  eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  std::shared_ptr<WireCounters> counters;  // shared with the transports, which outlive their maker
};

}  // namespace covey
