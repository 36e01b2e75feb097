// SPDX-License-Identifier: Apache-2.0
#include "comms/ros1_messages.h"

#include <utility>

#include "comms/byte_fields.h"

namespace covey {
namespace {

// The stamp of a std_msgs/Header; 0, which nobody stamps with, for what is none.
TimeNs read_header(ByteFields& fields) {
  constexpr TimeNs kSecond_ns = 1'000'000'000;
  (void)fields.number<std::uint32_t>();  // how many before it
  const auto seconds = TimeNs{fields.number<std::uint32_t>()};
  const auto nanoseconds = TimeNs{fields.number<std::uint32_t>()};
  (void)fields.text();  // frame
  return nanoseconds < kSecond_ns ? seconds * kSecond_ns + nanoseconds : 0;
}

Eigen::Vector3d read_vector(ByteFields& fields) {
  const double x = fields.real(), y = fields.real(), z = fields.real();
  return {x, y, z};
}

void skip_reals(ByteFields& fields, int count) {
  for (int i = 0; i < count; ++i) (void)fields.real();
}

RosImage read_image(ByteFields& fields) {
  RosImage image;
  image.stamp_ns = read_header(fields);
  image.height = fields.number<std::uint32_t>();
  image.width = fields.number<std::uint32_t>();
  image.encoding = fields.text();
  image.is_big_endian = fields.number<std::uint8_t>() != 0;
  image.step = fields.number<std::uint32_t>();
  const auto size = fields.number<std::uint32_t>();
  image.data = fields.bytes(size);
  return image;
}

PackedImage read_packed_image(ByteFields& fields) {
  PackedImage image;
  image.stamp_ns = read_header(fields);
  image.format = fields.text();
  const auto size = fields.number<std::uint32_t>();
  image.file = fields.bytes(size);
  return image;
}

ImuSample read_imu(ByteFields& fields) {
  constexpr int kOrientation = 4, kCovariance = 9;
  ImuSample sample;
  sample.stamp_ns = read_header(fields);
  skip_reals(fields, kOrientation + kCovariance);
  sample.gyro_imu = read_vector(fields);
  skip_reals(fields, kCovariance);
  sample.accel_imu = read_vector(fields);
  skip_reals(fields, kCovariance);
  return sample;
}

template <typename Read>
auto decoded(const Bytes& bytes, const Read& read)
    -> decltype(checked(read(std::declval<ByteFields&>()))) {
  try {
    ByteFields fields(bytes);
    auto message = read(fields);
    if (!fields.at_end()) return Rejected{"sample has bytes left over"};
    return checked(std::move(message));
  } catch (const Unreadable&) {
    return Rejected{"sample ends too early"};
  }
}

}  // namespace

Decoded<CameraImage> decode_ros1_image(const Bytes& bytes) { return decoded(bytes, read_image); }
Decoded<PackedImage> decode_ros1_packed_image(const Bytes& bytes) {
  return decoded(bytes, read_packed_image);
}
Decoded<ImuSample> decode_ros1_imu(const Bytes& bytes) { return decoded(bytes, read_imu); }

}  // namespace covey
