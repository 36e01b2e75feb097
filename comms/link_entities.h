// SPDX-License-Identifier: Apache-2.0
//
// What a link is made of in DDS: a participant with its topics, writers and readers, and the
// listeners that hand to the LinkState what those hear. Inside this room only.
#pragma once

#include <chrono>
#include <deque>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <memory>
#include <string>

#include "comms/counting_transport.h"
#include "comms/dds_owners.h"
#include "comms/link_events.h"
#include "comms/link_state.h"
#include "comms/peer_link.h"

namespace covey {

// Creating entities inside a DDS callback can lock up: whatever creates, describes or deletes one
// belongs to one thread of ours at a time, first the one that makes this, then the housekeeper, at
// last the one that ends this. The three writers to all may be used from any thread.
class LinkEntities {
 public:
  using Writer = eprosima::fastdds::dds::DataWriter;
  using Time = std::chrono::steady_clock::time_point;

  // Throws std::runtime_error that names the entity and what to do. The first two must outlive it.
  LinkEntities(const LinkConfig& config, LinkState& state, const std::shared_ptr<Wire>& wire);
  LinkEntities(const LinkEntities&) = delete;
  LinkEntities& operator=(const LinkEntities&) = delete;

  [[nodiscard]] Writer* request_writer() const { return request_writer_; }
  [[nodiscard]] Writer* status_writer() const { return status_writer_; }
  [[nodiscard]] Writer* odometry_writer() const { return odometry_writer_; }

  // Ends with its last owner, who has to be gone before this is. Throws as above.
  [[nodiscard]] std::shared_ptr<Writer> create_answer_writer(const std::string& receiver);

  // DDS offers the descriptions of its endpoints again after a second only, and of offer, request
  // and description each may be lost. So they are repeated for who waits to be linked.
  [[nodiscard]] Time next_repeat() const;
  void repeat_descriptions_when_due();

 private:
  using Reader = eprosima::fastdds::dds::DataReader;
  using Topic = eprosima::fastdds::dds::Topic;

  void create_participant(const std::shared_ptr<Wire>& wire);
  void register_types();
  Topic* create_topic(Kind kind, const std::string& receiver);
  Writer* create_writer(Kind kind, WriterEvents* events, const std::string& receiver = "");
  void create_reader(Kind kind, ReaderEvents* events, const std::string& receiver = "");
  void delete_answer_writer(Writer* writer);

  const LinkConfig& config_;
  const Kind message_kind_;
  LinkState& state_;

  // Listeners outlive the participant that calls them.
  DiscoveryEvents discovery_events_;
  WriterEvents request_written_{state_, Channel::kRequestOut};
  WriterEvents message_written_{state_, Channel::kMessageOut};
  WriterEvents status_written_{state_, Channel::kStatusOut};
  ReaderEvents request_read_{state_, Kind::kRequest, Channel::kRequestIn};
  ReaderEvents message_read_{state_, message_kind_, Channel::kMessageIn};
  ReaderEvents status_read_{state_, Kind::kStatus, Channel::kStatusIn};
  ParticipantOwner participant_;
  PublisherOwner publisher_;
  // Owned by these two.
  eprosima::fastdds::dds::Subscriber* subscriber_ = nullptr;
  Writer* request_writer_ = nullptr;
  Writer* status_writer_ = nullptr;
  Writer* odometry_writer_ = nullptr;

  // In the order in which peers were told of them.
  std::deque<Writer*> writers_described_;
  std::deque<Reader*> readers_described_;
  Time last_repeat_;
};

}  // namespace covey
