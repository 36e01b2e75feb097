// SPDX-License-Identifier: Apache-2.0
//
// Passes everything on as it is, but for malformed packets that arrive (rtps_check.h): those are
// counted and go no further.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <atomic>
#include <cstdint>
#include <memory>

namespace covey {

using PacketCount = std::atomic<std::uint64_t>;

struct CheckedTransportDescriptor : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  CheckedTransportDescriptor(
      std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
      std::shared_ptr<PacketCount> malformed);
  eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  std::shared_ptr<PacketCount> malformed;  // shared with the transports, which outlive their maker
};

}  // namespace covey
