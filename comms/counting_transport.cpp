// SPDX-License-Identifier: Apache-2.0
#include "comms/counting_transport.h"

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>
#include <fastrtps/utils/IPLocator.h>

#include <utility>

#include "comms/rtps_check.h"

namespace covey {
namespace {

using eprosima::fastdds::rtps::ChainingTransport;
using eprosima::fastdds::rtps::LocatorsIterator;
using eprosima::fastdds::rtps::TransportReceiverInterface;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::SenderResource;

constexpr std::uint64_t kHeaderBytes = 20 + 8;  // IPv4 without options, UDP

// A walk over destinations that remembers how many datagrams it made: one for each destination.
class CountedWalk : public LocatorsIterator {
 public:
  // A socket that is there for multicast alone passes over all other destinations.
  CountedWalk(LocatorsIterator& walk, bool only_multicast)
      : walk_(walk), only_multicast_(only_multicast) {}
  LocatorsIterator& operator++() override {
    if (!only_multicast_ || IPLocator::isMulticast(*walk_)) ++datagrams_;
    ++walk_;
    return *this;
  }
  bool operator==(const LocatorsIterator& other) const override { return walk_ == other; }
  bool operator!=(const LocatorsIterator& other) const override { return walk_ != other; }
  const Locator_t& operator*() const override { return *walk_; }
  [[nodiscard]] std::uint64_t datagrams() const { return datagrams_; }

 private:
  LocatorsIterator& walk_;
  const bool only_multicast_;
  std::uint64_t datagrams_ = 0;
};

class CountingTransport : public ChainingTransport {
 public:
  explicit CountingTransport(const CountingTransportDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor) {}

  eprosima::fastdds::rtps::TransportDescriptorInterface* get_configuration() override {
    return &descriptor_;
  }

  bool send(SenderResource* below, const eprosima::fastrtps::rtps::octet* buffer,
            std::uint32_t size, LocatorsIterator* begin, LocatorsIterator* end,
            const std::chrono::steady_clock::time_point& timeout) override {
    SenderResource* nobody = nullptr;
    const bool first = first_socket_.compare_exchange_strong(nobody, below) || nobody == below;
    CountedWalk walk(*begin, !first);
    const bool sent = below->send(buffer, size, &walk, end, timeout);
    descriptor_.counters->bytes_sent += walk.datagrams() * (kHeaderBytes + size);
    return sent;
  }

  void receive(TransportReceiverInterface* next, const eprosima::fastrtps::rtps::octet* buffer,
               std::uint32_t size, const Locator_t& local, const Locator_t& remote) override {
    descriptor_.counters->bytes_received += kHeaderBytes + size;
    if (!is_rtps_message(buffer, size)) {
      ++descriptor_.counters->malformed_received;
      return;
    }
    next->OnDataReceived(buffer, size, local, remote);
  }

  // The base class does not hand these two down.
  void shutdown() override { low_level_transport_->shutdown(); }
  void update_network_interfaces() override { low_level_transport_->update_network_interfaces(); }

 private:
  CountingTransportDescriptor descriptor_;
  // UDP opens one socket for everything, then one per interface for multicast.
  std::atomic<SenderResource*> first_socket_{nullptr};
};

}  // namespace

CountingTransportDescriptor::CountingTransportDescriptor(
    std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> below,
    std::shared_ptr<WireCounters> counters_in)
    : ChainingTransportDescriptor(std::move(below)), counters(std::move(counters_in)) {}

eprosima::fastdds::rtps::TransportInterface* CountingTransportDescriptor::create_transport() const {
  return std::make_unique<CountingTransport>(*this).release();  // DDS takes ownership
}

}  // namespace covey
