// SPDX-License-Identifier: Apache-2.0
#include "comms/checked_transport.h"

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>

#include <chrono>
#include <cstddef>
#include <utility>

#include "comms/rtps_check.h"

namespace covey {
namespace {

using eprosima::fastdds::rtps::ChainingTransport;
using eprosima::fastdds::rtps::LocatorsIterator;
using eprosima::fastdds::rtps::SendResourceList;
using eprosima::fastdds::rtps::TransportReceiverInterface;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::octet;
using eprosima::fastrtps::rtps::SenderResource;

class CheckedTransport : public ChainingTransport {
 public:
  explicit CheckedTransport(const CheckedTransportDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor) {}

  eprosima::fastdds::rtps::TransportDescriptorInterface* get_configuration() override {
    return &descriptor_;
  }

  // The transport below must be told of every locator, but is not shown which sockets there are: it
  // opens more each time, and what goes to many would be said by each of them again.
  bool OpenOutputChannel(SendResourceList& sockets, const Locator_t& to) override {
    const std::size_t before = sockets.size();
    const bool open = ChainingTransport::OpenOutputChannel(sockets, to);
    if (can_send_) sockets.resize(before);
    can_send_ = can_send_ || open;
    return open;
  }

  bool send(SenderResource* below, const octet* buffer, std::uint32_t size, LocatorsIterator* begin,
            LocatorsIterator* end, const std::chrono::steady_clock::time_point& timeout) override {
    return below->send(buffer, size, begin, end, timeout);
  }

  void receive(TransportReceiverInterface* next, const octet* buffer, std::uint32_t size,
               const Locator_t& local, const Locator_t& remote) override {
    if (is_rtps_message(buffer, size))
      next->OnDataReceived(buffer, size, local, remote);
    else
      ++*descriptor_.malformed;
  }

  // The base class does not hand these two down.
  void shutdown() override { low_level_transport_->shutdown(); }
  void update_network_interfaces() override { low_level_transport_->update_network_interfaces(); }

 private:
  CheckedTransportDescriptor descriptor_;
  bool can_send_ = false;
};

}  // namespace

CheckedTransportDescriptor::CheckedTransportDescriptor(
    std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
    std::shared_ptr<PacketCount> malformed_in)
    : ChainingTransportDescriptor(std::move(below)), malformed(std::move(malformed_in)) {}

eprosima::fastdds::rtps::TransportInterface* CheckedTransportDescriptor::create_transport() const {
  return std::make_unique<CheckedTransport>(*this).release();  // DDS takes ownership
}

}  // namespace covey
