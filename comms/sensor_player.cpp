// SPDX-License-Identifier: Apache-2.0
#include "comms/sensor_player.h"

#include "comms/onboard_participant.h"
#include "comms/onboard_topics.h"

namespace covey {

struct SensorPlayer::Impl {
  explicit Impl(const OnboardConfig& config)
      : participant({config.domain, config.loopback_only}),
        images(participant.write(image_topic(config.image_topic), Keep::kAll)),
        imu(participant.write(imu_topic(config.imu_topic, config.imu_message), Keep::kAll)),
        imu_message(config.imu_message) {}

  OnboardParticipant participant;
  OnboardWriter images, imu;
  ImuMessage imu_message;
};

SensorPlayer::SensorPlayer(const OnboardConfig& config) : impl_(std::make_unique<Impl>(config)) {}
SensorPlayer::~SensorPlayer() = default;

bool SensorPlayer::play(const CameraImage& image) { return impl_->images.send(encode(image)); }

bool SensorPlayer::play(const ImuSample& sample) {
  const bool px4 = impl_->imu_message == ImuMessage::kPx4;
  return impl_->imu.send(px4 ? encode_px4_imu(sample) : encode(sample));
}

bool SensorPlayer::is_heard() const {
  return impl_->images.readers() > 0 && impl_->imu.readers() > 0;
}

bool SensorPlayer::wait_until_received(std::chrono::milliseconds patience) {
  return impl_->images.wait_until_received(patience) && impl_->imu.wait_until_received(patience);
}

}  // namespace covey
