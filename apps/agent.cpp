// SPDX-License-Identifier: Apache-2.0
#include "apps/agent.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "apps/earlier_flight.h"
#include "apps/flight_findings.h"
#include "apps/grey_image.h"
#include "apps/json_file.h"
#include "apps/link_figures.h"
#include "apps/link_process.h"
#include "apps/stop_signal.h"
#include "comms/checks.h"
#include "comms/peer_link.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

Dataset recording_of(const AgentSettings& agent) {
  if (agent.dataset.empty()) throw std::runtime_error("agent.dataset says no folder");
  Dataset dataset = read_recording(agent.dataset);
  if (agent.duration_s > 0) {
    const TimeNs end_ns = dataset.images.front().stamp_ns + nanoseconds(agent.duration_s);
    auto& images = dataset.images;
    while (images.size() > 1 && images.back().stamp_ns > end_ns) images.pop_back();
  }
  return dataset;
}

fs::path make_folder(const AgentSettings& agent) {
  std::error_code error;
  fs::create_directories(agent.out, error);
  if (error) throw std::runtime_error(agent.out + ": cannot be made: " + error.message());
  if (const auto earlier = set_aside_earlier_flight(agent.out))
    spdlog::info("an earlier flight is in {} now", earlier->string());
  return agent.out;
}

// Whether the whole filter fits into a message.
void require_sendable(const EstimatorConfig& estimator) {
  constexpr int kImuAndCalibration = 15 + 7;  // intrinsics stay at home
  const int states =
      kImuAndCalibration + 6 * (estimator.max_clones + 1) + 3 * estimator.max_slam_features;
  if (states <= kMaxFilterDimension) return;
  throw std::runtime_error("a filter of up to " + std::to_string(states) +
                           " states does not fit into the messages of exchanges 'paper' and "
                           "'naive', which hold " +
                           std::to_string(kMaxFilterDimension) +
                           ": lower estimator.max_clones or estimator.max_slam_features");
}

// In lockstep every step waits for what the others have sent and counts it: a laboratory's tool,
// whose link may well be in this process. Whoever flies by a clock waits for no link.
std::unique_ptr<Link> open_link(const AgentConfig& config) {
  if (config.agent.mode == FlightMode::kSolo) return nullptr;
  const LinkConfig link = link_config(config);
  if (link.full_messages) require_sendable(config.estimator);
  if (config.agent.pace == Pace::kLockstep) return std::make_unique<PeerLink>(link);
  return std::make_unique<LinkProcess>(config);
}

// When it was sent, as far as the message tells: handling must not depend on who was quicker.
std::pair<TimeNs, std::string> order_of(const Inbound& inbound) {
  return std::visit(
      [](const auto& message) {
        using Message = std::decay_t<decltype(message)>;
        if constexpr (std::is_same_v<Message, AgentStatus>) {
          return std::pair(message.stamp_ns, message.agent);
        } else if constexpr (std::is_same_v<Message, PeerKeyframe>) {
          return std::pair(message.pose.stamp_ns, message.sender);
        } else if constexpr (std::is_same_v<Message, FullPeerKeyframe>) {
          return std::pair(message.keyframe.pose.stamp_ns, message.keyframe.sender);
        } else {
          return std::pair(message.stamp_ns, message.sender);
        }
      },
      inbound);
}

const AgentConfig& checked(const AgentConfig& config) {
  require_possible(config);
  if (config.agent.out.empty()) throw std::runtime_error("agent.out says no folder");
  return config;
}

}  // namespace

bool is_status_due(const std::optional<AgentStatus>& told, const AgentStatus& status) {
  constexpr double kInterval_s = 5;  // nobody on board waits for it
  return !told || told->status != status.status ||
         seconds_between(told->stamp_ns, status.stamp_ns) >= kInterval_s;
}

Agent::Agent(const AgentConfig& config)
    : Agent(config, recording_of(checked(config).agent), nullptr) {}

Agent::Agent(const AgentConfig& config, Dataset sensors, OnboardLink& onboard)
    : Agent(checked(config), std::move(sensors), &onboard) {}

Agent::Agent(const AgentConfig& config, Dataset dataset, OnboardLink* onboard)
    : config_(config),
      dataset_(std::move(dataset)),
      pipeline_(config, sensors_of(dataset_), std::exchange(dataset_.ground_truth, std::nullopt)),
      link_(open_link(config)),
      onboard_(onboard),
      folder_(make_folder(config.agent)),
      status_file_(folder_ / kAgentStatusFile),
      odometry_file_(folder_),
      timing_file_(folder_),
      link_file_(folder_),
      exchange_file_(folder_),
      warnings_(config, dataset_.line_delay_s) {
  if (pipeline_.calibration() != nullptr) {
    thermal_file_.emplace(folder_);
    pictures_.emplace(dataset_.images);
  }
  if (!dataset_.images.empty()) first_ns_ = dataset_.images.front().stamp_ns;
}

// Those that images have used are gone but for the last two, about the image; without images the
// oldest go.
void Agent::add_imu(const std::vector<ImuSample>& samples) {
  constexpr std::ptrdiff_t kMostWaiting = 20'000;
  std::vector<ImuSample>& imu = dataset_.imu;
  const std::ptrdiff_t used =
      std::max<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(next_imu_) - 2, 0);
  imu.erase(imu.begin(), imu.begin() + used);
  next_imu_ -= static_cast<std::size_t>(used);
  imu.insert(imu.end(), samples.begin(), samples.end());
  const auto waiting = static_cast<std::ptrdiff_t>(imu.size() - next_imu_);
  if (waiting > kMostWaiting) {
    imu.erase(imu.begin(), imu.end() - kMostWaiting);
    next_imu_ = 0;
  }
  if (config_.onboard.odometry_rate_hz > 0) tell_predicted();
}

void Agent::fly(TimeNs stamp_ns, const cv::Mat& pixels, double read_ms) {
  const double start_ms = thread_cpu_ms();
  add_imu_for(stamp_ns, dataset_.imu, next_imu_, pipeline_);
  ImageResult result = pipeline_.add_image(stamp_ns, pixels);
  if (!first_ns_) first_ns_ = stamp_ns;
  last_ns_ = stamp_ns;
  counts_.add(result);
  warnings_.of_image(result, pipeline_.started());
  publish(result);
  write(result, read_ms, read_ms + thread_cpu_ms() - start_ms);
  picture(result, pixels);
  show_status();
  const double now_ms = steady_ms();
  if (cpu_load_.due(now_ms)) cpu_load_.sample(now_ms, cpu_s());
}

// With the link's process, where it has one.
double Agent::cpu_s() const {
  if (!link_) return process_cpu_s();
  return process_cpu_s() + 1e-3 * static_cast<double>(link_->statistics().process_cpu_ms);
}

void Agent::tell_predicted() {
  constexpr double kEarly = 0.1;    // of the interval: IMU samples come when they come
  constexpr double kLongest_s = 1;  // without an image; the IMU alone soon knows nothing
  if (dataset_.imu.empty()) return;
  const ImuSample& newest = dataset_.imu.back();
  if (seconds_between(last_ns_, newest.stamp_ns) > kLongest_s) return;
  const double interval_s = 1 / config_.onboard.odometry_rate_hz;
  if (seconds_between(told_motion_ns_, newest.stamp_ns) < (1 - kEarly) * interval_s) return;
  const std::optional<Odometry> odometry = pipeline_.predicted(dataset_.imu);
  if (!odometry || odometry->stamp_ns <= told_motion_ns_) return;
  tell(*odometry, newest);
  told_motion_ns_ = odometry->stamp_ns;
}

void Agent::tell(const Odometry& odometry, const ImuSample& newest) {
  BodyMotion motion;
  motion.odometry = odometry;
  motion.gyro_imu = newest.gyro_imu - odometry.gyro_bias;
  motion.restarts = static_cast<std::uint8_t>(counts_.reinitialized);
  onboard_->publish(motion);
}

void Agent::publish(const ImageResult& result) {
  const bool at_images = onboard_ != nullptr && config_.onboard.odometry_rate_hz == 0;
  if (at_images && result.odometry) tell(*result.odometry, dataset_.imu[next_imu_ - 1]);
  if (!link_) return;
  if (result.advert && link_->send(*result.advert)) {
    note(ExchangeEvent::kAsked, kEveryPeer, result.advert->keyframe_id);
  }
  if (result.announcement && link_->send(*result.announcement)) {
    note(ExchangeEvent::kAnswered, kEveryPeer, result.announcement->keyframe.pose.keyframe_id);
  }
  if (result.odometry) link_->publish(*result.odometry);
  publish_status();
}

void Agent::publish_status() {
  const AgentStatus status = pipeline_.status();
  if (!is_status_due(told_status_, status)) return;
  link_->publish(status);
  told_status_ = status;
}

void Agent::show_status() {
  if (!status_file_.due(steady_ms())) return;
  write_status();
  warnings_.of_camera(pipeline_);
  if (!link_) return;
  warnings_.of_link(link_->statistics());
  warnings_.of_team(pipeline_, peer_counts_);
}

void Agent::write_status() { status_file_.write(status_json(), steady_ms()); }

nlohmann::json Agent::status_json() const {
  nlohmann::json status = {
      {"stamp_s", counts_.frames > 0 ? seconds_between(*first_ns_, last_ns_) : 0.0},
      {"frames", counts_.frames},
      {"frames_dropped", counts_.dropped},
      {"memory_mib", own_memory_mib()}};
  if (!link_) return status;
  status.update(link_status_json(link_->peers(), link_->statistics(), peer_counts_));
  return status;
}

void Agent::note(ExchangeEvent event, const std::string& peer, std::uint64_t keyframe_id) {
  exchange_file_.write({steady_ms(), event, peer, keyframe_id});
}

void Agent::write(ImageResult& result, double read_ms, double total_ms) {
  if (result.odometry) odometry_file_.write(*result.odometry);
  result.timing.read_ms = read_ms;
  result.timing.total_ms = total_ms;
  timing_file_.write(result.timing);
  if (link_)
    link_file_.write(link_record(result.timing.stamp_ns, link_->statistics(), peer_counts_));
  if (result.calibrated && result.content == ImageContent::kScene) {
    thermal_file_->write(
        {result.timing.stamp_ns, result.calibrated->chain_ns, pipeline_.calibration()->map()});
  }
}

void Agent::picture(const ImageResult& result, const cv::Mat& pixels) {
  if (!pictures_ || result.content != ImageContent::kScene) return;
  if (!pictures_->is_due(result.timing.stamp_ns)) return;
  pictures_->add(to_grey8(pixels).clone(), picture_of(result, pipeline_));
}

bool Agent::meet(const std::set<std::string>& peers, std::chrono::milliseconds patience) {
  return !link_ || peers.empty() || wait_for_peers(peers, patience);
}

bool Agent::meet(std::size_t peers, std::chrono::milliseconds patience) {
  return !link_ || peers == 0 || wait_for_peers(peers, patience);
}

std::string Agent::words_on_peers(std::size_t expected) const {
  return covey::words_on_peers(link_->peers(), expected, link_->statistics());
}

template <typename Peers>
bool Agent::wait_for_peers(const Peers& peers, std::chrono::milliseconds patience) {
  constexpr std::chrono::milliseconds kStopPoll{200};
  const auto deadline = std::chrono::steady_clock::now() + patience;
  bool met = false;
  do {
    met = link_->wait_for_peers(peers, kStopPoll);
    show_status();
  } while (!met && !stop_requested() && std::chrono::steady_clock::now() <= deadline);
  write_status();
  return met;
}

ArrivalCounts Agent::wait_for_arrivals(const ArrivalCounts& expected,
                                       std::chrono::milliseconds patience) {
  if (!link_) return {};
  if (link_->wait_for_inbox(expected, patience)) return expected;
  return link_->arrived();
}

void Agent::take_inbox() {
  if (!link_) return;
  for (Inbound& inbound : link_->take()) taken_.push_back(std::move(inbound));
}

void Agent::handle_messages() {
  std::vector<Inbound> messages = std::exchange(taken_, {});
  std::stable_sort(messages.begin(), messages.end(),
                   [](const Inbound& a, const Inbound& b) { return order_of(a) < order_of(b); });
  for (const Inbound& inbound : messages) {
    std::visit([this](const auto& message) { handle(message); }, inbound);
  }
}

void Agent::handle(const PlaceAdvert& advert) {
  note(ExchangeEvent::kHeard, advert.sender, advert.keyframe_id);
  const auto answer = pipeline_.answer(advert);
  if (!answer) return;
  if (send(*answer)) {
    note(ExchangeEvent::kAnswered, advert.sender, advert.keyframe_id);
  }
}

bool Agent::send(const PeerKeyframe& answer) {
  if (config_.collaboration.exchange == ExchangeMode::kCompact) return link_->send(answer);
  const auto full = pipeline_.with_filter(answer);
  return full && link_->send(*full);
}

void Agent::handle(const PeerKeyframe& keyframe) {
  const PeerResult result = pipeline_.fuse(keyframe);
  if (!keyframe.found) {
    count_answer(result.outcome, keyframe);
  } else if (result.outcome == PeerOutcome::kFused) {
    ++peer_counts_.learned;
    note(ExchangeEvent::kLearned, keyframe.sender, keyframe.request_keyframe_id);
  }
  if (result.reply && link_->send(*result.reply)) {
    note(ExchangeEvent::kTold, keyframe.sender, keyframe.request_keyframe_id);
  }
}

void Agent::count_answer(PeerOutcome outcome, const PeerKeyframe& keyframe) {
  const std::uint64_t id =
      keyframe.receiver.empty() ? keyframe.pose.keyframe_id : keyframe.request_keyframe_id;
  switch (outcome) {
    case PeerOutcome::kFused:
      ++peer_counts_.fused;
      note(ExchangeEvent::kFused, keyframe.sender, id);
      break;
    case PeerOutcome::kGated:
      ++peer_counts_.gated;
      note(ExchangeEvent::kGated, keyframe.sender, id);
      break;
    case PeerOutcome::kRejected:
      ++peer_counts_.rejected;
      note(ExchangeEvent::kRejected, keyframe.sender, id);
      break;
  }
}

double Agent::own_memory_mib() const {
  const double link_kib = link_ ? static_cast<double>(link_->statistics().process_own_kib) : 0.0;
  return memory_mib("self", "RssAnon").value_or(0) + link_kib / 1024;
}

std::optional<std::string> Agent::not_started() const {
  if (pipeline_.started()) return {};
  return pipeline_.not_started();
}

AdvancedReply Agent::progress() const {
  AdvancedReply reply;
  reply.reached_ns = last_ns_;
  if (link_) {
    const LinkStatistics statistics = link_->statistics();
    reply.requests_sent = statistics.request.sent;
    reply.messages_sent_to = statistics.messages_sent_to;
  }
  return reply;
}

AgentSummary Agent::summary() const {
  AgentSummary summary;
  summary.frames = counts_.frames;
  summary.frames_dropped = counts_.dropped;
  if (pipeline_.start_ns()) {
    summary.initialised_after_s = seconds_between(*first_ns_, *pipeline_.start_ns());
  }
  summary.not_started = not_started();
  summary.max_rss_mib = peak_rss_mib();
  if (link_ && summary.max_rss_mib)
    *summary.max_rss_mib += static_cast<double>(link_->statistics().process_peak_kib) / 1024;
  summary.max_cpu_percent = cpu_load_.max_percent();
  if (counts_.frames > 0) {
    const auto frames = static_cast<double>(counts_.frames);
    summary.cpu_ms_per_frame = 1e3 * cpu_s() / frames;
    summary.mean_tracks_per_frame = static_cast<double>(counts_.track_sightings) / frames;
  }
  if (counts_.tracks_begun > 0) {
    summary.mean_track_length =
        static_cast<double>(counts_.track_sightings) / static_cast<double>(counts_.tracks_begun);
  }
  if (link_) summary.link = link_summary(link_->statistics(), peer_counts_);
  summary.lost_lines = lost_lines();
  return summary;
}

LostLines Agent::lost_lines() const {
  LostLines lost = odometry_file_.lost_lines();
  lost.merge(timing_file_.lost_lines());
  lost.merge(link_file_.lost_lines());
  lost.merge(exchange_file_.lost_lines());
  if (thermal_file_) lost.merge(thermal_file_->lost_lines());
  return lost;
}

// Without it the summary still says how the flight went.
void Agent::keep_calibration() const {
  try {
    write_field(folder_, pipeline_.calibration()->field());
    pictures_->write(folder_, dataset_.mask);
  } catch (const std::exception& error) {
    spdlog::warn("{}", error.what());
  }
}

AgentSummary Agent::finish(const std::optional<std::string>& incomplete) {
  warnings_.of_camera(pipeline_);
  if (link_) warnings_.of_team(pipeline_, peer_counts_);
  write_status();
  if (link_) link_->close();
  if (pipeline_.calibration() != nullptr) keep_calibration();
  AgentSummary told = summary();
  told.incomplete = incomplete;
  nlohmann::json json = to_json(told);
  if (link_) {
    json["exchange_details"] = exchange_json(pipeline_, link_->statistics(), peer_counts_.learned);
  }
  json["camera"] = camera_json(pipeline_);
  json["own_world"] = level_frame_json(pipeline_.own_world());
  if (pipeline_.team_knowledge() != nullptr) {
    json["peer_worlds"] = peer_worlds_json(*pipeline_.team_knowledge());
  }
  json["filter"] = filter_json(counts_);
  write_json_file(folder_ / kAgentSummaryFile, json);
  return told;
}

}  // namespace covey
