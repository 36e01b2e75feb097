// SPDX-License-Identifier: Apache-2.0
#include "comms/link_events.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <iterator>
#include <utility>

#include "comms/byte_type.h"
#include "comms/checks.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using std::chrono::steady_clock;

PeerId peer_id(const rtps::InstanceHandle_t& endpoint) {
  return covey::peer_id(rtps::iHandle2GUID(endpoint).guidPrefix);
}

}  // namespace

PeerId peer_id(const rtps::GuidPrefix_t& prefix) {
  PeerId id{};
  std::copy(std::begin(prefix.value), std::end(prefix.value), id.begin());
  return id;
}

DiscoveryEvents::DiscoveryEvents(LinkState& state, std::string message_prefix)
    : state_(state), message_prefix_(std::move(message_prefix)) {}

void DiscoveryEvents::on_subscriber_discovery(dds::DomainParticipant* /*participant*/,
                                              rtps::ReaderDiscoveryInfo&& info) {
  if (info.status == rtps::ReaderDiscoveryInfo::REMOVED_READER) return;
  const std::string topic = info.info.topicName().to_string();
  if (topic.compare(0, message_prefix_.size(), message_prefix_) != 0) return;
  const std::string name = topic.substr(message_prefix_.size());
  if (is_agent_name(name)) state_.name_peer(peer_id(info.info.guid().guidPrefix), name);
}

void DiscoveryEvents::on_participant_discovery(dds::DomainParticipant* /*participant*/,
                                               rtps::ParticipantDiscoveryInfo&& info) {
  const PeerId id = peer_id(info.info.m_guid.guidPrefix);
  if (info.status == rtps::ParticipantDiscoveryInfo::REMOVED_PARTICIPANT ||
      info.status == rtps::ParticipantDiscoveryInfo::DROPPED_PARTICIPANT)
    state_.remove_participant(id);
  else
    state_.enter_participant(id, steady_clock::now());
}

void WriterEvents::on_publication_matched(dds::DataWriter* /*writer*/,
                                          const dds::PublicationMatchedStatus& status) {
  state_.change_matches(peer_id(status.last_subscription_handle), channel_,
                        status.current_count_change, steady_clock::now());
}

void ReaderEvents::on_data_available(dds::DataReader* reader) {
  using eprosima::fastrtps::types::ReturnCode_t;
  ByteSample sample;
  dds::SampleInfo info;
  while (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK)
    if (info.valid_data) receive(sample.bytes, peer_id(info.publication_handle));
}

void ReaderEvents::on_subscription_matched(dds::DataReader* /*reader*/,
                                           const dds::SubscriptionMatchedStatus& status) {
  state_.change_matches(peer_id(status.last_publication_handle), channel_,
                        status.current_count_change, steady_clock::now());
}

void ReaderEvents::receive(const Bytes& bytes, const PeerId& from) {
  try {
    state_.receive(kind_, bytes, from);
  } catch (const std::exception&) {
    state_.reject(from, "out of memory");
  }
}

}  // namespace covey
