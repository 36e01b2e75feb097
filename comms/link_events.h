// SPDX-License-Identifier: Apache-2.0
//
// What DDS tells us, on its own threads. Each event is handed to the LinkState and that is all: no
// DDS entity is created or written here, which could lock up, and no exception leaves.
#pragma once

#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <string>

#include "comms/link_state.h"

namespace covey {

[[nodiscard]] PeerId peer_id(const eprosima::fastrtps::rtps::GuidPrefix_t& prefix);

// Who comes and goes. Who reads the topic <message_prefix><name> is the drone of that name.
class DiscoveryEvents : public eprosima::fastdds::dds::DomainParticipantListener {
 public:
  DiscoveryEvents(LinkState& state, std::string message_prefix);

  void on_subscriber_discovery(eprosima::fastdds::dds::DomainParticipant* participant,
                               eprosima::fastrtps::rtps::ReaderDiscoveryInfo&& info) override;
  void on_participant_discovery(eprosima::fastdds::dds::DomainParticipant* participant,
                                eprosima::fastrtps::rtps::ParticipantDiscoveryInfo&& info) override;

 private:
  LinkState& state_;
  const std::string message_prefix_;
};

class WriterEvents : public eprosima::fastdds::dds::DataWriterListener {
 public:
  WriterEvents(LinkState& state, Channel channel) : state_(state), channel_(channel) {}

  void on_publication_matched(
      eprosima::fastdds::dds::DataWriter* writer,
      const eprosima::fastdds::dds::PublicationMatchedStatus& status) override;

 private:
  LinkState& state_;
  const Channel channel_;
};

class ReaderEvents : public eprosima::fastdds::dds::DataReaderListener {
 public:
  ReaderEvents(LinkState& state, Kind kind, Channel channel)
      : state_(state), kind_(kind), channel_(channel) {}

  void on_data_available(eprosima::fastdds::dds::DataReader* reader) override;
  void on_subscription_matched(
      eprosima::fastdds::dds::DataReader* reader,
      const eprosima::fastdds::dds::SubscriptionMatchedStatus& status) override;

 private:
  void receive(const Bytes& bytes, const PeerId& from);

  LinkState& state_;
  const Kind kind_;
  const Channel channel_;
};

}  // namespace covey
