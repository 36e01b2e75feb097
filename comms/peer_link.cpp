// SPDX-License-Identifier: Apache-2.0
#include "comms/peer_link.h"

#include <algorithm>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "comms/answer_writers.h"
#include "comms/byte_type.h"
#include "comms/checks.h"
#include "comms/config_check.h"
#include "comms/dds_log.h"
#include "comms/dispatcher.h"
#include "comms/link_entities.h"
#include "comms/link_state.h"
#include "comms/link_topics.h"
#include "comms/outbox.h"
#include "comms/qos.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr char kNotThere[] = "receiver is not there";

// Who goes on being silent after it should have answered is gone. In between a reliable status
// is offered to it again and again.
TeamWatch team_watch(const LinkConfig& config) {
  TeamWatch watch;
  const milliseconds sign(config.profile.discovery.sign_of_life_ms);
  watch.silence.gone = milliseconds(config.profile.status.liveliness_ms);
  watch.silence.doubt = sign + (watch.silence.gone - sign) / 6;
  watch.others = other_drones(config);
  watch.team_size = config.team_size;
  return watch;
}

std::shared_ptr<Wire> wire_heard_by(LinkState& state) {
  auto wire = std::make_shared<Wire>();
  wire->heard = [&state](const Packet& packet) { state.hear(packet, steady_clock::now()); };
  wire->quiet = [&state] { return state.complete(steady_clock::now()); };
  return wire;
}

std::size_t readers_of(dds::DataWriter& writer) {
  dds::PublicationMatchedStatus status;
  writer.get_publication_matched_status(status);
  return static_cast<std::size_t>(std::max(status.current_count, 0));
}

bool acknowledged(dds::DataWriter& writer, steady_clock::time_point deadline) {
  using eprosima::fastrtps::types::ReturnCode_t;
  const auto left = duration_cast<milliseconds>(deadline - steady_clock::now());
  return writer.wait_for_acknowledgments(duration(std::max(left, milliseconds(0)))) ==
         ReturnCode_t::RETCODE_OK;
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
  void keep_house();
  steady_clock::time_point next_sign();
  void give_sign_when_due();
  bool publish_status();

  template <typename Message>
  bool may_send(Kind kind, const Message& message, const std::string& sender);
  bool send_to(const std::set<std::string>& receivers, const PeerKeyframe& keyframe, Bytes bytes);
  std::set<std::string> reached(const std::set<std::string>& receivers);
  [[nodiscard]] Dispatcher::Radio radio();
  bool send_now(Outgoing out);
  bool send_message(Kind kind, const std::set<std::string>& receivers, Bytes bytes);
  bool write(Kind kind, dds::DataWriter& writer, Bytes bytes);
  bool put(Kind kind, dds::DataWriter& writer, ByteSample& sample);

  const LinkConfig config_;
  const Kind message_kind_;
  LinkState state_;
  const std::shared_ptr<Wire> wire_;
  LinkEntities entities_;
  AnswerWriters answer_writers_;  // end before the entities

  std::mutex status_mutex_;  // one status after the other: the newest has to be the last
  AgentStatus status_;
  steady_clock::time_point last_sign_;  // of life, to all

  Dispatcher dispatcher_;

  std::mutex farewell_mutex_;   // who comes second waits until it is over
  bool said_farewell_ = false;  // and joined the threads

  std::thread housekeeper_;
};

PeerLink::Impl::Impl(const LinkConfig& config, const WallClock& clock)
    : config_((check(config), config)),
      message_kind_(message_kind(config)),
      state_(config.agent, config.inbox_limit, team_watch(config), clock),
      wire_(wire_heard_by(state_)),
      entities_(config_, state_, wire_),
      answer_writers_(config_, state_, entities_),
      dispatcher_(config_.profile.load, radio()) {
  status_.agent = config_.agent;
  publish_status();
  housekeeper_ = std::thread([this] { keep_house(); });
}

void PeerLink::Impl::close() {
  const std::lock_guard farewell_lock(farewell_mutex_);
  if (std::exchange(said_farewell_, true)) return;
  state_.close();
  dispatcher_.close();
  if (housekeeper_.joinable()) housekeeper_.join();
  const milliseconds farewell(config_.profile.discovery.farewell_ms);
  if (farewell > farewell.zero()) flush(farewell);
}

bool PeerLink::Impl::flush(milliseconds timeout) {
  const std::vector<AnswerWriters::Writer> writers = answer_writers_.all();
  const auto deadline = steady_clock::now() + timeout;
  return acknowledged(*entities_.request_writer(), deadline) &&
         std::all_of(writers.begin(), writers.end(), [&](const AnswerWriters::Writer& writer) {
           return acknowledged(*writer, deadline);
         });
}

// ----------------------------------------------------------------------------------- housekeeping

// Creating entities and writing inside a DDS callback can lock up: both happen on a thread of ours.
void PeerLink::Impl::keep_house() {
  std::vector<std::uint64_t> told;
  while (const auto news =
             state_.wait_for_housekeeping(std::min(next_sign(), entities_.next_repeat()))) {
    answer_writers_.create_for(news->names);
    entities_.repeat_descriptions_when_due();
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
  entities_.status_writer()->assert_liveliness();
  last_sign_ = steady_clock::now();
}

bool PeerLink::Impl::publish_status() {
  const std::lock_guard lock(status_mutex_);
  last_sign_ = steady_clock::now();
  return write(Kind::kStatus, *entities_.status_writer(), encode(state_.to_be_said(status_)));
}

// ---------------------------------------------------------------------------------------- sending

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

bool PeerLink::Impl::send(const PlaceAdvert& advert) {
  return may_send(Kind::kRequest, advert, advert.sender) &&
         dispatcher_.send({Kind::kRequest, {}, 0, worth(advert), encode(advert)});
}

bool PeerLink::Impl::send(const PeerKeyframe& keyframe) {
  return may_send(Kind::kMessage, keyframe, keyframe.sender) &&
         send_to({keyframe.receiver}, keyframe, encode(keyframe));
}

bool PeerLink::Impl::send(const FullPeerKeyframe& message) {
  if (!may_send(Kind::kFullMessage, message, message.keyframe.sender)) return false;
  const std::string& receiver = message.keyframe.receiver;
  const auto receivers =
      receiver.empty() ? answer_writers_.receivers() : std::set<std::string>{receiver};
  return send_to(receivers, message.keyframe, encode(message));
}

bool PeerLink::Impl::publish(const Odometry& odometry) {
  return may_send(Kind::kOdometry, odometry, config_.agent) &&
         dispatcher_.send({Kind::kOdometry,
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
  return dispatcher_.send({message_kind_, there, landmarks_of, worth(keyframe), std::move(bytes)});
}

Dispatcher::Radio PeerLink::Impl::radio() {
  return {[this](Outgoing out) { return send_now(std::move(out)); },
          [this] { return wire_->bytes_sent.load(); },
          [this] {
            return Audience{state_.peers().size(), readers_of(*entities_.odometry_writer())};
          }};
}

bool PeerLink::Impl::send_now(Outgoing out) {
  if (out.kind == Kind::kRequest)
    return write(out.kind, *entities_.request_writer(), std::move(out.bytes));
  if (out.kind == Kind::kOdometry)
    return write(out.kind, *entities_.odometry_writer(), std::move(out.bytes));
  return send_message(out.kind, out.receivers, std::move(out.bytes));
}

// Counts as sent once, to however many.
bool PeerLink::Impl::send_message(Kind kind, const std::set<std::string>& receivers, Bytes bytes) {
  ByteSample sample{std::move(bytes)};
  bool sent = false;
  for (const std::string& receiver : receivers) {
    const AnswerWriters::Writer writer = answer_writers_.writer_to(receiver);
    if (writer == nullptr || !state_.reaches(receiver)) {
      state_.count_refused(kind, kNotThere);
    } else if (put(kind, *writer, sample)) {
      state_.count_message_to(receiver);
      sent = true;
    }
  }
  if (sent) state_.count_sent(kind, sample.bytes.size());
  return sent;
}

bool PeerLink::Impl::write(Kind kind, dds::DataWriter& writer, Bytes bytes) {
  ByteSample sample{std::move(bytes)};
  if (!put(kind, writer, sample)) return false;
  state_.count_sent(kind, sample.bytes.size());
  return true;
}

bool PeerLink::Impl::put(Kind kind, dds::DataWriter& writer, ByteSample& sample) {
  if (writer.write(&sample)) return true;
  state_.count_refused(kind, "DDS did not take it: history full, a peer does not acknowledge");
  return false;
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
  statistics.dropped = dispatcher_.dropped();
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
