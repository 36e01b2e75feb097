// SPDX-License-Identifier: Apache-2.0
//
// What a broken or hostile radio may say, below the level of plain structs.
#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "comms/checks.h"
#include "comms/convert.h"
#include "idl/covey.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

using eprosima::fastcdr::Cdr;

template <typename T>
std::string reason(const Decoded<T>& decoded) {
  const auto* rejected = std::get_if<Rejected>(&decoded);
  return rejected == nullptr ? "" : rejected->reason;
}

// Any decoder, asked only for the reason.
using Decoder = std::function<std::string(const Bytes&)>;
struct MessageType {
  const char* name;
  Decoder decode;
  Bytes good;
};
std::vector<MessageType> message_types() {
  return {
      {"RequestUAV", [](const Bytes& b) { return reason(decode_place_advert(b)); },
       encode(samples::advert())},
      {"MessageUAV", [](const Bytes& b) { return reason(decode_peer_keyframe(b)); },
       encode(samples::keyframe())},
      {"MessageUAV of what was found",
       [](const Bytes& b) { return reason(decode_peer_keyframe(b)); }, encode(samples::found())},
      {"FullMessageUAV", [](const Bytes& b) { return reason(decode_full_keyframe(b)); },
       encode(samples::full_keyframe())},
      {"AgentStatus", [](const Bytes& b) { return reason(decode_status(b)); },
       encode(StatusSample{samples::status(), {{1, 5, 6}, {2, 7, 8}, {3}}, 9})},
      {"Odometry", [](const Bytes& b) { return reason(decode_odometry(b)); },
       encode(OdometrySample{"uav0", samples::odometry()})},
  };
}

template <typename Wire>
Bytes serialize(const Wire& wire, Cdr::Endianness order = Cdr::LITTLE_ENDIANNESS) {
  Bytes bytes(1 << 20);
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  Cdr cdr(buffer, order, Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  wire.serialize(cdr);
  bytes.resize(cdr.getSerializedDataLength());
  return bytes;
}

template <typename Wire>
Wire parse(const Bytes& bytes) {
  eprosima::fastcdr::FastBuffer buffer(
      reinterpret_cast<char*>(const_cast<std::uint8_t*>(bytes.data())), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  cdr.read_encapsulation();
  Wire wire;
  wire.deserialize(cdr);
  return wire;
}

wire::RequestUAV request() { return parse<wire::RequestUAV>(encode(samples::advert())); }
wire::MessageUAV message() { return parse<wire::MessageUAV>(encode(samples::keyframe())); }

TEST(HostileBytes, EveryTruncationIsRejected) {
  for (const MessageType& type : message_types())
    for (std::size_t size = 0; size < type.good.size(); ++size)
      EXPECT_NE(type.decode(Bytes(type.good.begin(), type.good.begin() + static_cast<long>(size))),
                "")
          << type.name << " cut to " << size;
}

TEST(HostileBytes, PaddingIsAcceptedAndMoreIsNot) {
  for (const MessageType& type : message_types()) {
    Bytes bytes = type.good;
    bytes.resize(type.good.size() + 3);
    EXPECT_EQ(type.decode(bytes), "") << type.name;
    bytes.resize(type.good.size() + 4);
    EXPECT_EQ(type.decode(bytes), "sample has bytes left over") << type.name;
  }
}

TEST(HostileBytes, TooLargeASampleIsNotEvenRead) {
  for (const MessageType& type : message_types()) {
    Bytes bytes = type.good;
    bytes.resize(1 << 20);
    EXPECT_EQ(type.decode(bytes), "sample too large") << type.name;
  }
}

TEST(HostileBytes, OtherVersionsAreRejectedByName) {
  for (const MessageType& type : message_types())
    for (const int version : {0, kWireVersion - 1, kWireVersion + 1, 255}) {
      Bytes bytes = type.good;
      bytes[4] = static_cast<std::uint8_t>(version);
      EXPECT_EQ(type.decode(bytes), "another version of the messages") << type.name;
    }
}

TEST(HostileBytes, OtherEncapsulationsAreRejected) {
  // Parameter lists, XCDR2, and plain nonsense: some of these make generated code throw.
  for (const MessageType& type : message_types())
    for (const int header : {0x0002, 0x0003, 0x0006, 0x0009, 0x0100, 0xffff}) {
      Bytes bytes = type.good;
      bytes[0] = static_cast<std::uint8_t>(header >> 8);
      bytes[1] = static_cast<std::uint8_t>(header & 0xff);
      EXPECT_EQ(type.decode(bytes), "unknown encapsulation") << type.name;
    }
}

TEST(HostileBytes, TheOtherByteOrderIsUnderstood) {
  const Bytes bytes = serialize(request(), Cdr::BIG_ENDIANNESS);
  EXPECT_EQ(bytes[1], 0);
  const auto decoded = decode_place_advert(bytes);
  ASSERT_EQ(reason(decoded), "");
  EXPECT_EQ(std::get<PlaceAdvert>(decoded).keyframe_id, samples::advert().keyframe_id);
  EXPECT_EQ(std::get<PlaceAdvert>(decoded).descriptor, samples::advert().descriptor);
}

TEST(HostileBytes, SequencesBeyondTheirBoundsAreRejected) {
  wire::RequestUAV long_request = request();
  long_request.descriptor().resize(4097);
  EXPECT_EQ(reason(decode_place_advert(serialize(long_request))), "place descriptor too long");

  wire::MessageUAV long_message = message();
  long_message.descriptors().resize(8 * 257);
  long_message.bearings().resize(2 * 257);
  long_message.inverse_depths().resize(257, long_message.inverse_depths().front());
  long_message.depth_sigmas().resize(257, long_message.depth_sigmas().front());
  long_message.patches().resize(8 * 257);
  EXPECT_EQ(reason(decode_peer_keyframe(serialize(long_message))), "too many landmarks");

  wire::MessageUAV from_two_sides = message();
  from_two_sides.before().push_back(from_two_sides.before().front());
  EXPECT_EQ(reason(decode_peer_keyframe(serialize(from_two_sides))),
            "more than one keyframe before");

  wire::AgentStatus crowded =
      parse<wire::AgentStatus>(encode(StatusSample{samples::status(), {{1}}}));
  crowded.hears().resize(65);
  EXPECT_EQ(reason(decode_status(serialize(crowded))), "too many peers in a status");
}

TEST(HostileBytes, ANameThatIsTooLongIsNotCutToAnotherName) {
  // Generated code would cut at 64; a drone of the shorter name may exist.
  for (const std::size_t length : {33u, 64u}) {
    wire::RequestUAV bytes = request();
    bytes.sender(std::string(length, 'a'));
    EXPECT_EQ(reason(decode_place_advert(serialize(bytes))), "sender is not a drone's name");
  }
}

TEST(HostileBytes, ListsThatDisagreeAreRejected) {
  const std::string complaint = "landmark lists of different lengths";
  const auto after = [](const auto& damage) {
    wire::MessageUAV bytes = message();
    damage(bytes);
    return reason(decode_peer_keyframe(serialize(bytes)));
  };
  EXPECT_EQ(after([](auto& m) { m.descriptors().pop_back(); }), complaint);
  EXPECT_EQ(after([](auto& m) { m.bearings().push_back(0); }), complaint);
  EXPECT_EQ(after([](auto& m) { m.inverse_depths().clear(); }), complaint);
  EXPECT_EQ(after([](auto& m) { m.depth_sigmas().push_back(0); }), complaint);
  EXPECT_EQ(after([](auto& m) { m.patches().pop_back(); }), complaint);
  EXPECT_EQ(after([](auto& m) { m.patch_spacing(0); }), complaint);

  const auto after_in_full = [](const auto& damage) {
    auto bytes = parse<wire::FullMessageUAV>(encode(samples::full_keyframe()));
    damage(bytes);
    return reason(decode_full_keyframe(serialize(bytes)));
  };
  EXPECT_EQ(after_in_full([](auto& m) { m.message().bearings().push_back(0); }), complaint);
  EXPECT_EQ(after_in_full([](auto& m) { m.covariance().pop_back(); }),
            "covariance of the filter is not square");
  EXPECT_EQ(after_in_full([](auto& m) { m.covariance().clear(); }),
            "covariance of the filter is not square");
  EXPECT_EQ(after_in_full([](auto& m) { m.covariance().resize(257 * 257); }), "filter too large");
  EXPECT_EQ(after_in_full([](auto& m) { m.state().resize(10'000); }),
            "sizes in the filter do not fit together");
  EXPECT_EQ(after_in_full([](auto& m) { m.covariance()[5] = std::nan(""); }),
            "covariance of the filter not plausible");
}

TEST(HostileBytes, NumbersThatOnlyTheWireCanHoldAreRejected) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  wire::MessageUAV bytes = message();
  bytes.keyframe().p_world_cam()[1] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(reason(decode_peer_keyframe(serialize(bytes))), "position not plausible");
  for (const float bad : {nan, 0.0F, 1e30F}) {
    bytes = message();
    bytes.before().front().q_world_cam_xyzw({bad, bad, bad, bad});
    EXPECT_EQ(reason(decode_peer_keyframe(serialize(bytes))), "attitude is not a unit quaternion");
  }
  bytes = message();
  bytes.keyframe().covariance()[0] = -1e-4F;
  EXPECT_EQ(reason(decode_peer_keyframe(serialize(bytes))),
            "pose covariance not positive definite or not plausible");
  bytes = message();
  bytes.bearings()[3] = std::numeric_limits<std::int16_t>::min();
  EXPECT_EQ(reason(decode_peer_keyframe(serialize(bytes))), "bearing not plausible");
  bytes = message();
  bytes.depth_sigmas()[5] = 255;
  EXPECT_EQ(reason(decode_peer_keyframe(serialize(bytes))), "depth uncertainty not plausible");

  for (const float bad : {nan, 0.0F, 1e30F}) {
    auto request = parse<wire::RequestUAV>(encode(samples::advert()));
    request.q_world_cam_xyzw({bad, bad, bad, bad});
    EXPECT_EQ(reason(decode_place_advert(serialize(request))), "attitude is not a unit quaternion");
  }
  auto odometry = parse<wire::Odometry>(encode(OdometrySample{"uav0", samples::odometry()}));
  odometry.q_world_imu_xyzw({0.5, 0.5, 0.5, 0.6});
  EXPECT_EQ(reason(decode_odometry(serialize(odometry))), "attitude is not a unit quaternion");
  auto status = parse<wire::AgentStatus>(encode(StatusSample{samples::status(), {}}));
  status.filter_status(17);
  EXPECT_EQ(reason(decode_status(serialize(status))), "unknown filter status");
  for (const TimeNs bad : {TimeNs{-1}, kMaxStampNs + 1, std::numeric_limits<TimeNs>::min()}) {
    const auto good = parse<wire::AgentStatus>(encode(StatusSample{samples::status(), {{1}}}));
    status = good;
    status.sent_ns(bad);
    EXPECT_EQ(reason(decode_status(serialize(status))), "stamp not plausible");
    status = good;
    status.hears()[0].sent_ns(bad);
    EXPECT_EQ(reason(decode_status(serialize(status))), "stamp not plausible");
    status = good;
    status.hears()[0].received_ns(bad);
    EXPECT_EQ(reason(decode_status(serialize(status))), "stamp not plausible");
  }
}

// A claimed length of 4 G elements, wherever a length might stand.
TEST(HostileBytes, AbsurdLengthsAtAnyPlaceDoNoHarm) {
  for (const MessageType& type : message_types())
    for (std::size_t at = 4; at + 4 <= std::min<std::size_t>(type.good.size(), 256); ++at)
      for (const std::uint32_t length : {0xffffffffU, 0x7fffffffU, 0x10000000U, 5000U}) {
        Bytes bytes = type.good;
        std::memcpy(bytes.data() + at, &length, sizeof(length));
        (void)type.decode(bytes);
      }
}

TEST(HostileBytes, RandomDamageDoesNoHarm) {
  std::mt19937 random(7);
  for (const MessageType& type : message_types())
    for (int round = 0; round < 4000; ++round) {
      Bytes bytes = type.good;
      const std::size_t first = round % 2 == 0 ? 0 : 5;  // half of them keep a good header
      for (int hits = 1 + static_cast<int>(random() % 8); hits > 0; --hits)
        bytes[first + random() % (bytes.size() - first)] = static_cast<std::uint8_t>(random());
      if (random() % 4 == 0) bytes.resize(random() % bytes.size());
      (void)type.decode(bytes);
    }
}

}  // namespace
}  // namespace covey
