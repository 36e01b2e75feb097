// SPDX-License-Identifier: Apache-2.0
#include "comms/onboard_link.h"

#include <Eigen/Geometry>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <utility>

#include "comms/onboard_participant.h"
#include "comms/onboard_topics.h"

namespace covey {
namespace {

Eigen::Quaterniond mount(const Eigen::Vector3d& rpy) {
  return Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX());
}

}  // namespace

class OnboardLink::Impl {
 public:
  Impl(const OnboardConfig& config, std::string frame, std::string child_frame);

  std::optional<CameraImage> next_image(std::chrono::milliseconds patience);
  std::vector<ImuSample> take_imu();
  bool wait_for_imu(TimeNs stamp_ns, std::chrono::milliseconds patience);
  void publish(const BodyMotion& motion);
  OnboardCounts counts() const;

 private:
  void receive_image(const Bytes& bytes);
  void receive_imu(const Bytes& bytes);
  void refuse(const std::string& topic, const std::string& reason);  // locked
  std::function<void(const std::string& policy)> unheard(const std::string& topic);

  const OnboardConfig config_;
  const std::string frame_, child_frame_;
  const Eigen::Quaterniond q_body_imu_;

  mutable std::mutex mutex_;
  std::condition_variable came_;
  StampOrder<CameraImage> image_order_;
  StampOrder<ImuSample> imu_order_;
  std::deque<CameraImage> images_;
  std::deque<ImuSample> imu_;
  TimeNs newest_imu_ns_ = 0;
  OnboardCounts counts_;

  OnboardParticipant participant_;  // ends first: its threads call what stands above
  std::optional<OnboardWriter> odometry_, px4_;
};

OnboardLink::Impl::Impl(const OnboardConfig& config, std::string frame, std::string child_frame)
    : config_(config),
      frame_(std::move(frame)),
      child_frame_(std::move(child_frame)),
      q_body_imu_(mount(config.imu_mount_rpy)),
      participant_({config.domain, config.loopback_only}) {
  if (!config.odometry_topic.empty())
    odometry_ = participant_.write(nav_odometry_topic(config.odometry_topic), Keep::kNewest);
  if (!config.px4_topic.empty())
    px4_ = participant_.write(px4_odometry_topic(config.px4_topic), Keep::kNewest);
  participant_.read(
      image_topic(config.image_topic), config.reliable,
      [this](const Bytes& bytes) { receive_image(bytes); }, unheard(config.image_topic));
  participant_.read(
      imu_topic(config.imu_topic, config.imu_message), config.reliable,
      [this](const Bytes& bytes) { receive_imu(bytes); }, unheard(config.imu_topic));
}

std::function<void(const std::string& policy)> OnboardLink::Impl::unheard(
    const std::string& topic) {
  return [this, topic](const std::string& policy) {
    const std::lock_guard lock(mutex_);
    refuse(topic, policy == kReliability
                      ? "its driver offers best effort alone, and onboard.reliable is true"
                      : "its driver's QoS differs in " + policy + " from what is asked for");
  };
}

void OnboardLink::Impl::refuse(const std::string& topic, const std::string& reason) {
  ++counts_.refused;
  counts_.last_refusal = topic + ": " + reason;
}

void OnboardLink::Impl::receive_image(const Bytes& bytes) {
  Decoded<CameraImage> decoded = decode_image(bytes);
  const std::lock_guard lock(mutex_);
  if (const auto* rejected = std::get_if<Rejected>(&decoded))
    return refuse(config_.image_topic, rejected->reason);
  ++counts_.images;
  for (CameraImage& image : image_order_.add(std::get<CameraImage>(std::move(decoded))))
    images_.push_back(std::move(image));
  for (; images_.size() > config_.image_queue; ++counts_.images_dropped) images_.pop_front();
  came_.notify_all();
}

void OnboardLink::Impl::receive_imu(const Bytes& bytes) {
  const Decoded<ImuSample> decoded =
      config_.imu_message == ImuMessage::kPx4 ? decode_px4_imu(bytes) : decode_imu(bytes);
  const std::lock_guard lock(mutex_);
  if (const auto* rejected = std::get_if<Rejected>(&decoded))
    return refuse(config_.imu_topic, rejected->reason);
  ++counts_.imu_samples;
  for (const ImuSample& sample : imu_order_.add(std::get<ImuSample>(decoded))) {
    imu_.push_back(sample);
    newest_imu_ns_ = sample.stamp_ns;
  }
  for (; imu_.size() > config_.imu_queue; ++counts_.imu_dropped) imu_.pop_front();
  came_.notify_all();
}

std::optional<CameraImage> OnboardLink::Impl::next_image(std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  if (!came_.wait_for(lock, patience, [this] { return !images_.empty(); })) return {};
  CameraImage image = std::move(images_.front());
  images_.pop_front();
  return image;
}

std::vector<ImuSample> OnboardLink::Impl::take_imu() {
  const std::lock_guard lock(mutex_);
  std::vector<ImuSample> samples(imu_.begin(), imu_.end());
  imu_.clear();
  return samples;
}

bool OnboardLink::Impl::wait_for_imu(TimeNs stamp_ns, std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  return came_.wait_for(lock, patience, [&] { return newest_imu_ns_ > stamp_ns; });
}

void OnboardLink::Impl::publish(const BodyMotion& motion) {
  if (odometry_) odometry_->send(encode_nav_odometry(motion, frame_, child_frame_));
  if (px4_) px4_->send(encode_px4_odometry(motion, q_body_imu_));
}

OnboardCounts OnboardLink::Impl::counts() const {
  const std::lock_guard lock(mutex_);
  OnboardCounts counts = counts_;
  counts.image_stamps = image_order_.counts();
  counts.imu_stamps = imu_order_.counts();
  counts.malformed_packets = participant_.malformed_packets();
  return counts;
}

OnboardLink::OnboardLink(const OnboardConfig& config, std::string frame, std::string child_frame)
    : impl_(std::make_unique<Impl>(config, std::move(frame), std::move(child_frame))) {}
OnboardLink::~OnboardLink() = default;

std::optional<CameraImage> OnboardLink::next_image(std::chrono::milliseconds patience) {
  return impl_->next_image(patience);
}
std::vector<ImuSample> OnboardLink::take_imu() { return impl_->take_imu(); }
bool OnboardLink::wait_for_imu(TimeNs stamp_ns, std::chrono::milliseconds patience) {
  return impl_->wait_for_imu(stamp_ns, patience);
}
void OnboardLink::publish(const BodyMotion& motion) { impl_->publish(motion); }
OnboardCounts OnboardLink::counts() const { return impl_->counts(); }

}  // namespace covey
