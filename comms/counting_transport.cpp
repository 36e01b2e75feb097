// SPDX-License-Identifier: Apache-2.0
#include "comms/counting_transport.h"

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <cstring>
#include <utility>

#include "comms/datagram_socket.h"
#include "comms/rtps_check.h"

namespace covey {
namespace {

using eprosima::fastdds::rtps::ChainingTransport;
using eprosima::fastdds::rtps::Locators;
using eprosima::fastdds::rtps::LocatorsIterator;
using eprosima::fastdds::rtps::TransportReceiverInterface;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::LocatorList_t;
using eprosima::fastrtps::rtps::octet;
using eprosima::fastrtps::rtps::SenderResource;

constexpr std::uint64_t kHeaderBytes = 20 + 8;  // IPv4 without options, UDP

// Where packets leave from, if it is one place.
std::unique_ptr<DatagramSocket> own_socket(const CountingTransportDescriptor& descriptor) {
  const auto* udp =
      dynamic_cast<const UDPv4TransportDescriptor*>(descriptor.low_level_descriptor.get());
  if (udp == nullptr || udp->interfaceWhiteList.size() > 1) return nullptr;
  const std::string from = udp->interfaceWhiteList.empty() ? "" : udp->interfaceWhiteList.front();
  return std::make_unique<DatagramSocket>(from, udp->sendBufferSize);
}

in_addr_t address_of(const Locator_t& locator) {
  in_addr_t out = 0;
  std::memcpy(&out, IPLocator::getIPv4(locator), sizeof(out));
  return out;
}

class CountingTransport : public ChainingTransport {
 public:
  explicit CountingTransport(const CountingTransportDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor), socket_(own_socket(descriptor)) {}

  eprosima::fastdds::rtps::TransportDescriptorInterface* get_configuration() override {
    return &descriptor_;
  }

  bool OpenInputChannel(const Locator_t& at, TransportReceiverInterface* receiver,
                        std::uint32_t max_message_bytes) override {
    const bool open = ChainingTransport::OpenInputChannel(at, receiver, max_message_bytes);
    std::uint32_t none = 0;
    if (open && !IPLocator::isMulticast(at))
      descriptor_.wire->first_port.compare_exchange_strong(none, at.port);
    return open;
  }

  bool send(SenderResource* below, const octet* buffer, std::uint32_t size, LocatorsIterator* begin,
            LocatorsIterator* end, const std::chrono::steady_clock::time_point& timeout) override {
    const Wire& wire = *descriptor_.wire;
    if (wire.quiet && is_announcement(buffer, size) && wire.quiet()) return true;
    SenderResource* nobody = nullptr;
    const bool first = first_socket_.compare_exchange_strong(nobody, below) || nobody == below;
    bool sent = true;
    for (; *begin != *end; ++*begin) {
      const bool multicast = IPLocator::isMulticast(**begin);
      if (!first && !multicast) continue;
      const bool taken = socket_ && !multicast ? send_plainly(buffer, size, **begin)
                                               : send_below(*below, buffer, size, **begin, timeout);
      sent = taken && sent;
    }
    return sent;
  }

  void receive(TransportReceiverInterface* next, const octet* buffer, std::uint32_t size,
               const Locator_t& local, const Locator_t& remote) override {
    descriptor_.wire->bytes_received += kHeaderBytes + size;
    if (!is_rtps_message(buffer, size)) {
      ++descriptor_.wire->malformed_received;
      return;
    }
    if (descriptor_.wire->heard)
      descriptor_.wire->heard(
          {sender_of(buffer), address_of(remote), is_announcement(buffer, size)});
    next->OnDataReceived(buffer, size, local, remote);
  }

  // The base class does not hand these two down.
  void shutdown() override { low_level_transport_->shutdown(); }
  void update_network_interfaces() override { low_level_transport_->update_network_interfaces(); }

 private:
  // Fast DDS, as Debian builds it, ends every packet with 60 bytes of statistics that nobody reads,
  // and its own transport insists on them.
  bool send_plainly(const octet* buffer, std::uint32_t size, const Locator_t& to) {
    const std::size_t plain = size_without_statistics(buffer, size);
    descriptor_.wire->bytes_sent += kHeaderBytes + plain;
    return socket_->send(buffer, plain, IPLocator::toIPv4string(to),
                         static_cast<std::uint16_t>(to.port));
  }

  bool send_below(SenderResource& below, const octet* buffer, std::uint32_t size,
                  const Locator_t& to, const std::chrono::steady_clock::time_point& timeout) {
    LocatorList_t one;
    one.push_back(to);
    Locators begin(one.begin()), end(one.end());
    descriptor_.wire->bytes_sent += kHeaderBytes + size;
    return below.send(buffer, size, &begin, &end, timeout);
  }

  CountingTransportDescriptor descriptor_;
  const std::unique_ptr<DatagramSocket> socket_;  // for all but multicast
  // UDP opens one socket for everything, then one per interface for multicast.
  std::atomic<SenderResource*> first_socket_{nullptr};
};

}  // namespace

CountingTransportDescriptor::CountingTransportDescriptor(
    std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
    std::shared_ptr<Wire> wire_in)
    : ChainingTransportDescriptor(std::move(below)), wire(std::move(wire_in)) {}

eprosima::fastdds::rtps::TransportInterface* CountingTransportDescriptor::create_transport() const {
  return std::make_unique<CountingTransport>(*this).release();  // DDS takes ownership
}

}  // namespace covey
