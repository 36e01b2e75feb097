// SPDX-License-Identifier: Apache-2.0
#include "comms/peer_link.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "comms/byte_type.h"
#include "comms/checks.h"
#include "comms/config_check.h"
#include "comms/dds_log.h"
#include "comms/dds_owners.h"
#include "comms/link_events.h"
#include "comms/link_network.h"
#include "comms/link_require.h"
#include "comms/link_state.h"
#include "comms/outbox.h"
#include "comms/qos.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastrtps::types::ReturnCode_t;
using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr char kNotThere[] = "receiver is not there";

const char* type_name(Kind kind) {
  switch (kind) {
    case Kind::kRequest:
      return "covey::wire::RequestUAV";
    case Kind::kMessage:
      return "covey::wire::MessageUAV";
    case Kind::kFullMessage:
      return "covey::wire::FullMessageUAV";
    case Kind::kStatus:
      return "covey::wire::AgentStatus";
    case Kind::kOdometry:
      break;
  }
  return "covey::wire::Odometry";
}

std::size_t max_bytes(Kind kind) {
  switch (kind) {
    case Kind::kRequest:
      return kMaxRequestBytes;
    case Kind::kMessage:
      return kMaxMessageBytes;
    case Kind::kFullMessage:
      return kMaxFullMessageBytes;
    case Kind::kStatus:
      return kMaxStatusBytes;
    case Kind::kOdometry:
      break;
  }
  return kMaxOdometryBytes;
}

std::string words_on_no_socket(const LinkConfig& config) {
  const std::string missing = link_network(config).missing;
  return missing.empty() ? "no UDP port of DDS domain " + std::to_string(config.domain) +
                               " is free: choose another link.domain"
                         : missing;
}

// Who goes on being silent after it should have answered is gone. In between a reliable status
// is offered to it again and again.
TeamWatch team_watch(const LinkConfig& config) {
  TeamWatch watch;
  const milliseconds sign(config.profile.discovery.sign_of_life_ms);
  watch.silence.gone = milliseconds(config.profile.status.liveliness_ms);
  watch.silence.doubt = sign + (watch.silence.gone - sign) / 6;
  watch.others = other_drones(config);
  return watch;
}

// A description replaces the last one of its endpoint. That of the oldest leaves no hole in what is
// offered, of which a peer would have to be told first.
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

std::size_t readers_of(dds::DataWriter& writer) {
  dds::PublicationMatchedStatus status;
  writer.get_publication_matched_status(status);
  return static_cast<std::size_t>(std::max(status.current_count, 0));
}

}  // namespace

// --------------------------------------------------------------------------------------- the link

class PeerLink::Impl {
 public:
  Impl(const LinkConfig& config, const WallClock& clock);

  bool send(const PlaceAdvert& advert);
  bool send(const PeerKeyframe& keyframe);
  bool send(const FullPeerKeyframe& message);
  bool publish(const Odometry& odometry);
  bool publish(const AgentStatus& status);
  bool flush(milliseconds timeout);
  void close();
  [[nodiscard]] LinkStatistics statistics() const;
  [[nodiscard]] LinkState& state() { return state_; }

 private:
  [[nodiscard]] std::string topic_name(Kind kind, const std::string& receiver = "") const;
  void create_participant();
  void register_types();
  dds::Topic* create_topic(Kind kind, const std::string& receiver);
  dds::DataWriter* create_writer(Kind kind, WriterEvents* events, const std::string& receiver = "");
  void create_reader(Kind kind, ReaderEvents* events, const std::string& receiver = "");

  void keep_house();
  using AnswerWriter = std::shared_ptr<dds::DataWriter>;
  void create_answer_writers(const std::set<std::string>& names);
  AnswerWriter create_answer_writer(const std::string& receiver);
  bool make_room_for_answers(const std::set<std::string>& names);
  void count_turned_away(std::set<std::string> names);
  AnswerWriter answer_writer(const std::string& receiver) const;
  bool acknowledged(dds::DataWriter* writer, steady_clock::time_point deadline) const;

  template <typename Message>
  bool may_send(Kind kind, const Message& message, const std::string& sender);
  bool send_when_there_is_room(Outgoing out);
  void send_what_may_go();
  void keep_sending();
  bool send_now(Outgoing out);
  bool write(Kind kind, dds::DataWriter* writer, Bytes bytes);
  bool put(Kind kind, dds::DataWriter* writer, ByteSample& sample);
  bool send_message(Kind kind, const std::set<std::string>& receivers, Bytes bytes);
  std::set<std::string> reached(const std::set<std::string>& receivers);
  bool send_to(const std::set<std::string>& receivers, const PeerKeyframe& keyframe, Bytes bytes);
  [[nodiscard]] std::set<std::string> everybody() const;
  bool publish_status();
  steady_clock::time_point next_sign();
  void give_sign_when_due();
  steady_clock::time_point next_repeat();
  void repeat_endpoints_when_due();

  const LinkConfig config_;
  const Kind message_kind_;
  LinkState state_;
  const std::shared_ptr<Wire> wire_ = std::make_shared<Wire>();

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
  dds::Subscriber* subscriber_ = nullptr;
  dds::DataWriter* request_writer_ = nullptr;
  dds::DataWriter* status_writer_ = nullptr;
  dds::DataWriter* odometry_writer_ = nullptr;

  mutable std::mutex answer_mutex_;                     // guards the map, not the writers
  std::map<std::string, AnswerWriter> answer_writers_;  // end before the publisher

  std::mutex status_mutex_;  // one status after the other: the newest has to be the last
  AgentStatus status_;
  steady_clock::time_point last_sign_;  // of life, to all

  // Waits for room on the radio; whoever holds the lock writes what comes out.
  mutable std::mutex outbox_mutex_;
  std::condition_variable outbox_changed_;
  Outbox outbox_;
  bool closed_ = false;

  std::mutex farewell_mutex_;   // who comes second waits until it is over
  bool said_farewell_ = false;  // and joined the threads

  // The housekeeper's, once it runs: endpoints in the order in which peers were told of them.
  std::deque<dds::DataWriter*> writers_described_;
  std::deque<dds::DataReader*> readers_described_;
  steady_clock::time_point last_repeat_;
  std::set<std::string> turned_away_;  // who is there and has no answer topic for want of room

  std::thread housekeeper_;
  std::thread dispatcher_;
};

PeerLink::Impl::Impl(const LinkConfig& config, const WallClock& clock)
    : config_((check(config), config)),
      message_kind_(config.full_messages ? Kind::kFullMessage : Kind::kMessage),
      state_(config.agent, config.inbox_limit, team_watch(config), clock),
      discovery_events_(state_, topic_name(message_kind_)),
      outbox_(config_.profile.load) {
  status_.agent = config_.agent;
  wire_->heard = [this](const Packet& packet) { state_.hear(packet, steady_clock::now()); };
  wire_->quiet = [this] { return state_.complete(steady_clock::now()); };
  create_participant();
  register_types();
  request_writer_ = create_writer(Kind::kRequest, &request_written_);
  status_writer_ = create_writer(Kind::kStatus, &status_written_);
  odometry_writer_ = create_writer(Kind::kOdometry, nullptr);  // who listens is not our affair
  create_reader(Kind::kStatus, &status_read_);
  create_reader(Kind::kRequest, &request_read_);
  create_reader(message_kind_, &message_read_, config_.agent);
  publish_status();
  housekeeper_ = std::thread([this] { keep_house(); });
  if (!outbox_.unlimited()) dispatcher_ = std::thread([this] { keep_sending(); });
}

void PeerLink::Impl::close() {
  const std::lock_guard farewell_lock(farewell_mutex_);
  if (std::exchange(said_farewell_, true)) return;
  state_.close();
  {
    const std::lock_guard lock(outbox_mutex_);
    closed_ = true;
  }
  outbox_changed_.notify_all();
  if (housekeeper_.joinable()) housekeeper_.join();
  if (dispatcher_.joinable()) dispatcher_.join();
  const milliseconds farewell(config_.profile.discovery.farewell_ms);
  if (farewell > farewell.zero()) flush(farewell);
}

bool PeerLink::Impl::flush(milliseconds timeout) {
  std::vector<AnswerWriter> writers;
  {
    const std::lock_guard lock(answer_mutex_);
    for (const auto& entry : answer_writers_) writers.push_back(entry.second);
  }
  const auto deadline = steady_clock::now() + timeout;
  return acknowledged(request_writer_, deadline) &&
         std::all_of(writers.begin(), writers.end(), [&](const AnswerWriter& writer) {
           return acknowledged(writer.get(), deadline);
         });
}

bool PeerLink::Impl::acknowledged(dds::DataWriter* writer,
                                  steady_clock::time_point deadline) const {
  const auto left = duration_cast<milliseconds>(deadline - steady_clock::now());
  return writer->wait_for_acknowledgments(duration(std::max(left, milliseconds(0)))) ==
         ReturnCode_t::RETCODE_OK;
}

std::string PeerLink::Impl::topic_name(Kind kind, const std::string& receiver) const {
  const std::string team = "covey/" + config_.team;
  switch (kind) {
    case Kind::kRequest:
      return team + "/request";
    case Kind::kMessage:
      return team + "/message/" + receiver;
    case Kind::kFullMessage:
      return team + "/full_message/" + receiver;
    case Kind::kStatus:
      return team + "/status";
    case Kind::kOdometry:
      break;
  }
  return team + "/odometry";
}

void PeerLink::Impl::create_participant() {
  keep_dds_errors();
  // Without data_on_readers: it would swallow data_available.
  participant_.reset(dds::DomainParticipantFactory::get_instance()->create_participant(
      static_cast<dds::DomainId_t>(config_.domain), participant_qos(config_, wire_),
      &discovery_events_, dds::StatusMask::none()));
  require(participant_ != nullptr,
          "cannot create the DDS participant of " + config_.agent + " in domain " +
              std::to_string(config_.domain) +
              ": check that the interfaces exist and that its UDP ports are free; DDS says: " +
              dds_errors().last);
  require(is_heard_at(wire_->first_port, config_),
          config_.agent + " hears nobody: " + words_on_no_socket(config_));
  state_.set_own_id(peer_id(participant_->guid().guidPrefix));
  publisher_ = create_publisher(*participant_);
  subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  require(publisher_ != nullptr && subscriber_ != nullptr,
          "cannot create DDS publisher and subscriber: out of memory?");
}

void PeerLink::Impl::register_types() {
  for (const Kind kind : {Kind::kRequest, message_kind_, Kind::kStatus, Kind::kOdometry}) {
    const KeyOf key_of = kind == Kind::kStatus ? key_of_status : nullptr;
    const dds::TypeSupport type(new ByteType(type_name(kind), max_bytes(kind), key_of));
    require(type.register_type(participant_.get()) == ReturnCode_t::RETCODE_OK,
            std::string("cannot register DDS type ") + type_name(kind));
  }
}

dds::Topic* PeerLink::Impl::create_topic(Kind kind, const std::string& receiver) {
  const std::string name = topic_name(kind, receiver);
  if (auto* known = dynamic_cast<dds::Topic*>(participant_->lookup_topicdescription(name)))
    return known;
  dds::Topic* topic = participant_->create_topic(name, type_name(kind), dds::TOPIC_QOS_DEFAULT);
  require(topic != nullptr, "cannot create DDS topic " + name);
  return topic;
}

dds::DataWriter* PeerLink::Impl::create_writer(Kind kind, WriterEvents* events,
                                               const std::string& receiver) {
  dds::Topic* topic = create_topic(kind, receiver);
  dds::DataWriter* writer = publisher_->create_datawriter(topic, writer_qos(kind, config_), events,
                                                          dds::StatusMask::publication_matched());
  require(writer != nullptr, "cannot create DDS writer of " + topic->get_name());
  writers_described_.push_back(writer);
  return writer;
}

void PeerLink::Impl::create_reader(Kind kind, ReaderEvents* events, const std::string& receiver) {
  dds::Topic* topic = create_topic(kind, receiver);
  const dds::StatusMask mask = dds::StatusMask::data_available()
                               << dds::StatusMask::subscription_matched();
  dds::DataReader* reader =
      subscriber_->create_datareader(topic, reader_qos(kind, config_), events, mask);
  require(reader != nullptr, "cannot create DDS reader of " + topic->get_name());
  readers_described_.push_back(reader);
}

// Creating entities and writing inside a DDS callback can lock up: both happen on a thread of ours.
void PeerLink::Impl::keep_house() {
  std::vector<std::uint64_t> told;
  while (const auto news = state_.wait_for_housekeeping(std::min(next_sign(), next_repeat()))) {
    create_answer_writers(news->names);
    repeat_endpoints_when_due();
    if (news->heard != told && publish_status())
      told = news->heard;
    else if (news->doubt)
      publish_status();  // whoever is there has to acknowledge it
    else
      give_sign_when_due();
  }
}

steady_clock::time_point PeerLink::Impl::next_sign() {
  const std::lock_guard lock(status_mutex_);
  return last_sign_ + milliseconds(config_.profile.discovery.sign_of_life_ms);
}

// A heartbeat: nobody answers it who has all that was said.
void PeerLink::Impl::give_sign_when_due() {
  if (steady_clock::now() < next_sign()) return;
  const std::lock_guard lock(status_mutex_);
  status_writer_->assert_liveliness();
  last_sign_ = steady_clock::now();
}

// Each drone's descriptions go to all others, so that all together give radio and processors more
// to do with the square of their number: more than a large team that meets at once can take.
steady_clock::time_point PeerLink::Impl::next_repeat() {
  constexpr int kMostParticipants = 8;
  const milliseconds interval(config_.profile.discovery.repeat_ms);
  const LinkState::Waiting waiting = state_.waiting(steady_clock::now());
  const bool some = waiting.since != steady_clock::time_point::max();
  if (interval == interval.zero() || !some || waiting.participants > kMostParticipants)
    return steady_clock::time_point::max();
  return std::max(waiting.since, last_repeat_) + interval;
}

// DDS offers the descriptions of its endpoints again after a second only, and of offer, request and
// description each may be lost. A change of user data is described, and all offered, at once.
void PeerLink::Impl::repeat_endpoints_when_due() {
  if (steady_clock::now() < next_repeat()) return;
  last_repeat_ = steady_clock::now();
  describe_oldest(writers_described_);
  describe_oldest(readers_described_);
}

// Holds the lock from creation to entry: a writer may be matched, and be asked for, in between.
void PeerLink::Impl::create_answer_writers(const std::set<std::string>& names) {
  const std::lock_guard lock(answer_mutex_);
  std::set<std::string> turned_away;
  for (const std::string& name : names) {
    if (name == config_.agent || answer_writers_.count(name) > 0) continue;
    if (!make_room_for_answers(names)) {
      turned_away.insert(name);
      continue;
    }
    try {
      answer_writers_[name] = create_answer_writer(name);
    } catch (const std::exception&) {
      state_.count_refused(message_kind_, "no answer topic for a peer: out of memory");
    }
  }
  count_turned_away(std::move(turned_away));
}

PeerLink::Impl::AnswerWriter PeerLink::Impl::create_answer_writer(const std::string& receiver) {
  return {create_writer(message_kind_, &message_written_, receiver), [this](auto* writer) {
            dds::Topic* topic = writer->get_topic();
            delete_writer(*publisher_, writer);
            participant_->delete_topic(topic);
          }};
}

// With the map locked. Who has left keeps its writer until another one needs the room: it may come
// back. Others take a writer under this lock and hold on to it while they use it, so that one that
// is only in the map is used by nobody.
bool PeerLink::Impl::make_room_for_answers(const std::set<std::string>& names) {
  if (answer_writers_.size() + 1 < static_cast<std::size_t>(config_.max_agents)) return true;
  const auto unused =
      std::find_if(answer_writers_.begin(), answer_writers_.end(), [&](const auto& entry) {
        return names.count(entry.first) == 0 && entry.second.use_count() == 1;
      });
  if (unused == answer_writers_.end()) return false;
  writers_described_.erase(
      std::remove(writers_described_.begin(), writers_described_.end(), unused->second.get()),
      writers_described_.end());
  answer_writers_.erase(unused);
  return true;
}

// Each once, until it has left or got its topic.
void PeerLink::Impl::count_turned_away(std::set<std::string> names) {
  for (const std::string& name : names)
    if (turned_away_.count(name) == 0) state_.count_refused(message_kind_, kCrowd);
  turned_away_ = std::move(names);
}

PeerLink::Impl::AnswerWriter PeerLink::Impl::answer_writer(const std::string& receiver) const {
  const std::lock_guard lock(answer_mutex_);
  const auto found = answer_writers_.find(receiver);
  return found == answer_writers_.end() ? nullptr : found->second;
}

template <typename Message>
bool PeerLink::Impl::may_send(Kind kind, const Message& message, const std::string& sender) {
  Problem problem = problem_with(message);
  if (!problem && sender != config_.agent) problem = "sender is not this drone";
  const bool is_message = kind == Kind::kMessage || kind == Kind::kFullMessage;
  if (!problem && is_message && kind != message_kind_)
    problem = "this team exchanges another sort of messages";
  if (problem) state_.count_refused(kind, *problem);
  return !problem;
}

bool PeerLink::Impl::send_when_there_is_room(Outgoing out) {
  if (outbox_.unlimited()) return send_now(std::move(out));
  {
    const std::lock_guard lock(outbox_mutex_);
    outbox_.offer(std::move(out), steady_clock::now());
    send_what_may_go();
  }
  outbox_changed_.notify_one();
  return true;
}

// With the outbox locked.
void PeerLink::Impl::send_what_may_go() {
  const Audience audience{state_.peers().size(), readers_of(*odometry_writer_)};
  while (auto out = outbox_.next(wire_->bytes_sent, audience, steady_clock::now()))
    send_now(*std::move(out));
}

void PeerLink::Impl::keep_sending() {
  constexpr milliseconds kRoomPoll{10};
  std::unique_lock lock(outbox_mutex_);
  while (!closed_) {
    if (outbox_.empty())
      outbox_changed_.wait(lock, [this] { return closed_ || !outbox_.empty(); });
    else
      outbox_changed_.wait_for(lock, kRoomPoll, [this] { return closed_; });
    if (!closed_) send_what_may_go();
  }
}

bool PeerLink::Impl::send_now(Outgoing out) {
  if (out.kind == Kind::kRequest) return write(out.kind, request_writer_, std::move(out.bytes));
  if (out.kind == Kind::kOdometry) return write(out.kind, odometry_writer_, std::move(out.bytes));
  return send_message(out.kind, out.receivers, std::move(out.bytes));
}

bool PeerLink::Impl::write(Kind kind, dds::DataWriter* writer, Bytes bytes) {
  ByteSample sample{std::move(bytes)};
  if (!put(kind, writer, sample)) return false;
  state_.count_sent(kind, sample.bytes.size());
  return true;
}

bool PeerLink::Impl::put(Kind kind, dds::DataWriter* writer, ByteSample& sample) {
  if (writer->write(&sample)) return true;
  state_.count_refused(kind, "DDS did not take it: history full, a peer does not acknowledge");
  return false;
}

// Counts as sent once, to however many.
bool PeerLink::Impl::send_message(Kind kind, const std::set<std::string>& receivers, Bytes bytes) {
  ByteSample sample{std::move(bytes)};
  bool sent = false;
  for (const std::string& receiver : receivers) {
    const AnswerWriter writer = answer_writer(receiver);
    if (writer == nullptr || !state_.reaches(receiver)) {
      state_.count_refused(kind, kNotThere);
    } else if (put(kind, writer.get(), sample)) {
      state_.count_message_to(receiver);
      sent = true;
    }
  }
  if (sent) state_.count_sent(kind, sample.bytes.size());
  return sent;
}

// Those of them who are there.
std::set<std::string> PeerLink::Impl::reached(const std::set<std::string>& receivers) {
  std::set<std::string> there;
  for (const std::string& receiver : receivers) {
    if (state_.reaches(receiver))
      there.insert(receiver);
    else
      state_.count_refused(message_kind_, kNotThere);
  }
  return there;
}

bool PeerLink::Impl::send_to(const std::set<std::string>& receivers, const PeerKeyframe& keyframe,
                             Bytes bytes) {
  const std::set<std::string> there = reached(receivers);
  if (there.empty()) return false;
  const std::uint64_t landmarks_of = keyframe.found ? 0 : keyframe.pose.keyframe_id;
  return send_when_there_is_room(
      {message_kind_, there, landmarks_of, worth(keyframe), std::move(bytes)});
}

std::set<std::string> PeerLink::Impl::everybody() const {
  const std::lock_guard lock(answer_mutex_);
  std::set<std::string> names;
  for (const auto& [name, writer] : answer_writers_)
    if (state_.reaches(name)) names.insert(name);
  return names;
}

bool PeerLink::Impl::publish_status() {
  const std::lock_guard lock(status_mutex_);
  last_sign_ = steady_clock::now();
  return write(Kind::kStatus, status_writer_, encode(state_.to_be_said(status_)));
}

bool PeerLink::Impl::send(const PlaceAdvert& advert) {
  return may_send(Kind::kRequest, advert, advert.sender) &&
         send_when_there_is_room({Kind::kRequest, {}, 0, worth(advert), encode(advert)});
}

bool PeerLink::Impl::send(const PeerKeyframe& keyframe) {
  return may_send(Kind::kMessage, keyframe, keyframe.sender) &&
         send_to({keyframe.receiver}, keyframe, encode(keyframe));
}

bool PeerLink::Impl::send(const FullPeerKeyframe& message) {
  if (!may_send(Kind::kFullMessage, message, message.keyframe.sender)) return false;
  const std::string& receiver = message.keyframe.receiver;
  const auto receivers = receiver.empty() ? everybody() : std::set<std::string>{receiver};
  return send_to(receivers, message.keyframe, encode(message));
}

bool PeerLink::Impl::publish(const Odometry& odometry) {
  return may_send(Kind::kOdometry, odometry, config_.agent) &&
         send_when_there_is_room({Kind::kOdometry,
                                  {},
                                  0,
                                  worth(odometry),
                                  encode(OdometrySample{config_.agent, odometry})});
}

bool PeerLink::Impl::publish(const AgentStatus& status) {
  if (!may_send(Kind::kStatus, status, status.agent)) return false;
  {
    const std::lock_guard lock(status_mutex_);
    status_ = status;
  }
  return publish_status();
}

LinkStatistics PeerLink::Impl::statistics() const {
  LinkStatistics statistics = state_.statistics();
  DdsErrors errors = dds_errors();
  statistics.dds_errors = errors.count;
  statistics.last_dds_error = std::move(errors.last);
  statistics.wire_bytes_sent = wire_->bytes_sent;
  statistics.wire_bytes_received = wire_->bytes_received;
  const std::uint32_t port = wire_->first_port;
  statistics.unseen_port = is_looked_at(port, config_) ? 0 : port;
  if (wire_->malformed_received > 0)
    statistics.rejected["unknown"]["malformed packet"] += wire_->malformed_received;
  const std::lock_guard lock(outbox_mutex_);
  statistics.dropped = outbox_.dropped();
  return statistics;
}

// ------------------------------------------------------------------------------------- the outside

PeerLink::PeerLink(const LinkConfig& config, const WallClock& clock)
    : impl_(std::make_unique<Impl>(config, clock)) {}
PeerLink::~PeerLink() { impl_->close(); }

bool PeerLink::send(const PlaceAdvert& advert) { return impl_->send(advert); }
bool PeerLink::send(const PeerKeyframe& keyframe) { return impl_->send(keyframe); }
bool PeerLink::send(const FullPeerKeyframe& message) { return impl_->send(message); }
bool PeerLink::publish(const Odometry& odometry) { return impl_->publish(odometry); }
bool PeerLink::publish(const AgentStatus& status) { return impl_->publish(status); }
bool PeerLink::flush(milliseconds timeout) { return impl_->flush(timeout); }
void PeerLink::close() { impl_->close(); }

std::vector<Inbound> PeerLink::take() { return impl_->state().take(); }
std::set<std::string> PeerLink::peers() const { return impl_->state().peers(); }
ArrivalCounts PeerLink::arrived() const { return impl_->state().arrived(); }
LinkStatistics PeerLink::statistics() const { return impl_->statistics(); }

bool PeerLink::wait_for_peers(const std::set<std::string>& names, milliseconds timeout) {
  const auto all_there = [&](const std::set<std::string>& linked) {
    return std::includes(linked.begin(), linked.end(), names.begin(), names.end());
  };
  return impl_->state().wait_for_peers(all_there, timeout);
}

bool PeerLink::wait_for_peers(std::size_t count, milliseconds timeout) {
  return impl_->state().wait_for_peers(
      [&](const std::set<std::string>& linked) { return linked.size() >= count; }, timeout);
}

bool PeerLink::wait_for_inbox(const ArrivalCounts& at_least, milliseconds timeout) {
  return impl_->state().wait_for_inbox(at_least, timeout);
}

}  // namespace covey
