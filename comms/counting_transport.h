// SPDX-License-Identifier: Apache-2.0
//
// Counts what really goes over the wire: every packet of this process, with discovery, heartbeats
// and repair, from the IPv4 header on, and tells who is heard. It passes everything on, but for
// malformed packets that arrive (rtps_check.h) and announcements that are of no use: those go no
// further.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>

#include "comms/peer_table.h"

namespace covey {

// The functions are called on DDS's threads and must not call DDS. Empty ones are not called.
struct Wire {
  std::atomic<std::uint64_t> bytes_sent{0};
  std::atomic<std::uint64_t> bytes_received{0};
  std::atomic<std::uint64_t> malformed_received{0};  // packets
  std::atomic<std::uint32_t> first_port{0};          // that listens: discovery's, once it does
  std::function<void(const Packet&)> heard;          // before DDS sees it
  std::function<bool()> quiet;                       // no announcement is of use now
};

struct CountingTransportDescriptor : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  CountingTransportDescriptor(
      std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
      std::shared_ptr<Wire> wire);
  eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  // A writer with piggyback adds a heartbeat whenever it has sent so many bytes: with every sample.
  [[nodiscard]] std::uint32_t min_send_buffer_size() const override { return 1; }

  std::shared_ptr<Wire> wire;  // shared with the transports, which outlive their maker
};

}  // namespace covey
