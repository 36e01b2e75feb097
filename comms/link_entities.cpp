// SPDX-License-Identifier: Apache-2.0
#include "comms/link_entities.h"

#include <algorithm>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <vector>

#include "comms/byte_type.h"
#include "comms/dds_log.h"
#include "comms/link_network.h"
#include "comms/link_require.h"
#include "comms/link_topics.h"
#include "comms/qos.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastrtps::types::ReturnCode_t;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

std::string words_on_no_socket(const LinkConfig& config) {
  const std::string missing = link_network(config).missing;
  return missing.empty() ? "no UDP port of DDS domain " + std::to_string(config.domain) +
                               " is free: choose another link.domain"
                         : missing;
}

// A description replaces the last one of its endpoint. That of the oldest leaves no hole in what is
// offered, of which a peer would have to be told first. A change of user data is described, and all
// offered, at once.
template <typename Endpoint>
void describe_oldest(std::deque<Endpoint*>& in_order) {
  Endpoint* oldest = in_order.front();
  in_order.pop_front();
  in_order.push_back(oldest);
  auto qos = oldest->get_qos();
  const std::size_t other_size = qos.user_data().empty() ? 1 : 0;
  qos.user_data().data_vec(std::vector<eprosima::fastrtps::rtps::octet>(other_size));
  oldest->set_qos(qos);
}

}  // namespace

LinkEntities::LinkEntities(const LinkConfig& config, LinkState& state,
                           const std::shared_ptr<Wire>& wire)
    : config_(config),
      message_kind_(message_kind(config)),
      state_(state),
      discovery_events_(state, link_topic(message_kind_, config.team).name) {
  create_participant(wire);
  register_types();
  request_writer_ = create_writer(Kind::kRequest, &request_written_);
  status_writer_ = create_writer(Kind::kStatus, &status_written_);
  odometry_writer_ = create_writer(Kind::kOdometry, nullptr);  // who listens is not our affair
  create_reader(Kind::kStatus, &status_read_);
  create_reader(Kind::kRequest, &request_read_);
  create_reader(message_kind_, &message_read_, config.agent);
}

void LinkEntities::create_participant(const std::shared_ptr<Wire>& wire) {
  keep_dds_errors();
  // Without data_on_readers: it would swallow data_available.
  participant_.reset(dds::DomainParticipantFactory::get_instance()->create_participant(
      static_cast<dds::DomainId_t>(config_.domain), participant_qos(config_, wire),
      &discovery_events_, dds::StatusMask::none()));
  require(participant_ != nullptr,
          "cannot create the DDS participant of " + config_.agent + " in domain " +
              std::to_string(config_.domain) +
              ": check that the interfaces exist and that its UDP ports are free; DDS says: " +
              dds_errors().last);
  require(is_heard_at(wire->first_port, config_),
          config_.agent + " hears nobody: " + words_on_no_socket(config_));
  state_.set_own_id(peer_id(participant_->guid().guidPrefix));
  publisher_ = create_publisher(*participant_);
  subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  require(publisher_ != nullptr && subscriber_ != nullptr,
          "cannot create DDS publisher and subscriber: out of memory?");
}

void LinkEntities::register_types() {
  for (const Kind kind : {Kind::kRequest, message_kind_, Kind::kStatus, Kind::kOdometry}) {
    const LinkTopic topic = link_topic(kind, config_.team);
    const dds::TypeSupport type(new ByteType(topic.type, topic.max_bytes, topic.key_of));
    require(type.register_type(participant_.get()) == ReturnCode_t::RETCODE_OK,
            std::string("cannot register DDS type ") + topic.type);
  }
}

dds::Topic* LinkEntities::create_topic(Kind kind, const std::string& receiver) {
  const LinkTopic topic = link_topic(kind, config_.team, receiver);
  if (auto* known = dynamic_cast<Topic*>(participant_->lookup_topicdescription(topic.name)))
    return known;
  Topic* out = participant_->create_topic(topic.name, topic.type, dds::TOPIC_QOS_DEFAULT);
  require(out != nullptr, "cannot create DDS topic " + topic.name);
  return out;
}

dds::DataWriter* LinkEntities::create_writer(Kind kind, WriterEvents* events,
                                             const std::string& receiver) {
  Topic* topic = create_topic(kind, receiver);
  Writer* writer = publisher_->create_datawriter(topic, writer_qos(kind, config_), events,
                                                 dds::StatusMask::publication_matched());
  require(writer != nullptr, "cannot create DDS writer of " + topic->get_name());
  writers_described_.push_back(writer);
  return writer;
}

void LinkEntities::create_reader(Kind kind, ReaderEvents* events, const std::string& receiver) {
  Topic* topic = create_topic(kind, receiver);
  const dds::StatusMask mask = dds::StatusMask::data_available()
                               << dds::StatusMask::subscription_matched();
  Reader* reader = subscriber_->create_datareader(topic, reader_qos(kind, config_), events, mask);
  require(reader != nullptr, "cannot create DDS reader of " + topic->get_name());
  readers_described_.push_back(reader);
}

std::shared_ptr<dds::DataWriter> LinkEntities::create_answer_writer(const std::string& receiver) {
  return {create_writer(message_kind_, &message_written_, receiver),
          [this](Writer* writer) { delete_answer_writer(writer); }};
}

void LinkEntities::delete_answer_writer(Writer* writer) {
  writers_described_.erase(
      std::remove(writers_described_.begin(), writers_described_.end(), writer),
      writers_described_.end());
  dds::Topic* topic = writer->get_topic();
  delete_writer(*publisher_, writer);
  participant_->delete_topic(topic);
}

// Each drone's descriptions go to all others, so that all together give radio and processors more
// to do with the square of their number: more than a large team that meets at once can take.
LinkEntities::Time LinkEntities::next_repeat() const {
  constexpr int kMostParticipants = 8;
  const milliseconds interval(config_.profile.discovery.repeat_ms);
  const LinkState::Waiting waiting = state_.waiting(steady_clock::now());
  const bool some = waiting.since != Time::max();
  if (interval == interval.zero() || !some || waiting.participants > kMostParticipants)
    return Time::max();
  return std::max(waiting.since, last_repeat_) + interval;
}

void LinkEntities::repeat_descriptions_when_due() {
  if (steady_clock::now() < next_repeat()) return;
  last_repeat_ = steady_clock::now();
  describe_oldest(writers_described_);
  describe_oldest(readers_described_);
}

}  // namespace covey
