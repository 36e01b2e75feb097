// SPDX-License-Identifier: Apache-2.0
#include "comms/checked_transport.h"

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <chrono>
#include <cstddef>
#include <cstring>
#include <utility>

#include "comms/datagram_socket.h"
#include "comms/own_addresses.h"
#include "comms/rtps_check.h"

namespace covey {
namespace {

using eprosima::fastdds::rtps::ChainingTransport;
using eprosima::fastdds::rtps::LocatorsIterator;
using eprosima::fastdds::rtps::SendResourceList;
using eprosima::fastdds::rtps::TransportReceiverInterface;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::LocatorList_t;
using eprosima::fastrtps::rtps::octet;
using eprosima::fastrtps::rtps::SenderResource;

constexpr char kLoopback[] = "127.0.0.1";

// From where what stays on this computer is sent; none where all may be reached.
std::unique_ptr<DatagramSocket> socket_here(const CheckedTransportDescriptor& descriptor) {
  const auto* udp =
      dynamic_cast<const UDPv4TransportDescriptor*>(descriptor.low_level_descriptor.get());
  if (udp == nullptr || descriptor.reach == Reach::kEverybody) return nullptr;
  auto out = std::make_unique<DatagramSocket>(kLoopback, udp->sendBufferSize);
  out->join(kDiscoveryGroup);
  return out;
}

class CheckedTransport : public ChainingTransport {
 public:
  explicit CheckedTransport(const CheckedTransportDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor), here_(socket_here(descriptor)) {}

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
    if (!here_) return below->send(buffer, size, begin, end, timeout);
    const std::size_t plain = size_without_statistics(buffer, size);
    bool sent = true;
    for (; *begin != *end; ++*begin) {
      const Locator_t& to = **begin;
      if (!IPLocator::isMulticast(to) && !is_here(to)) continue;
      const bool taken = here_->send(buffer, plain, IPLocator::toIPv4string(to),
                                     static_cast<std::uint16_t>(to.port));
      sent = taken && sent;
    }
    return sent;
  }

  void receive(TransportReceiverInterface* next, const octet* buffer, std::uint32_t size,
               const Locator_t& local, const Locator_t& remote) override {
    if (here_ && !is_here(remote)) return;
    if (is_rtps_message(buffer, size))
      next->OnDataReceived(buffer, size, local, remote);
    else
      ++*descriptor_.malformed;
  }

  // Where this computer's programs listen is told with all of its addresses.
  LocatorList_t NormalizeLocator(const Locator_t& locator) override {
    LocatorList_t out = ChainingTransport::NormalizeLocator(locator);
    if (!here_ || !IPLocator::isAny(locator)) return out;
    Locator_t loopback = locator;
    IPLocator::setIPv4(loopback, kLoopback);
    out.push_back(loopback);  // unless it is there
    return out;
  }

  // The base class does not hand these two down.
  void shutdown() override { low_level_transport_->shutdown(); }
  void update_network_interfaces() override { low_level_transport_->update_network_interfaces(); }

 private:
  bool is_here(const Locator_t& locator) {
    in_addr address{};
    std::memcpy(&address, IPLocator::getIPv4(locator), sizeof(address));
    return own_addresses_.contain(address);
  }

  CheckedTransportDescriptor descriptor_;
  const std::unique_ptr<DatagramSocket> here_;
  OwnAddresses own_addresses_;
  bool can_send_ = false;
};

}  // namespace

CheckedTransportDescriptor::CheckedTransportDescriptor(
    std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
    std::shared_ptr<PacketCount> malformed_in, Reach reach_in)
    : ChainingTransportDescriptor(std::move(below)),
      malformed(std::move(malformed_in)),
      reach(reach_in) {}

eprosima::fastdds::rtps::TransportInterface* CheckedTransportDescriptor::create_transport() const {
  return std::make_unique<CheckedTransport>(*this).release();  // DDS takes ownership
}

}  // namespace covey
