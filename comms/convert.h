// SPDX-License-Identifier: Apache-2.0
//
// Plain structs to serialised samples of idl/covey.idl and back. Bytes from another vehicle are
// untrusted: a decoder returns a checked struct or the reason why not, it never throws and never
// allocates more than a small multiple of what it was given. No DDS in here, so that a fuzzer can
// call exactly what the network calls.
//
// A sample is the 4-byte encapsulation header (CDR, either byte order) followed by the message.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "estimator/filter_snapshot.h"
#include "estimator/measurements.h"

namespace covey {

using Bytes = std::vector<std::uint8_t>;

inline constexpr std::uint8_t kWireVersion = 9;

// Largest samples that are sent or accepted, bytes: the bounds of idl/covey.idl, rounded up.
inline constexpr std::size_t kMaxRequestBytes = 4352;
inline constexpr std::size_t kMaxMessageBytes = 13824;
inline constexpr std::size_t kMaxFullMessageBytes = 544'000;
inline constexpr std::size_t kMaxStatusBytes = 1792;
inline constexpr std::size_t kMaxOdometryBytes = 384;

struct Rejected {
  std::string reason;  // from a fixed set: reasons are counted
};
template <typename T>
using Decoded = std::variant<T, Rejected>;

// A peer as a status names it (idl: HeardPeer).
struct HeardPeer {
  std::uint64_t token = 0;  // peer_table.h
  TimeNs sent_ns = 0, received_ns = 0;
};

// The status as it travels, with what the links tell each other.
struct StatusSample {
  AgentStatus status;
  std::vector<HeardPeer> hears;
  TimeNs sent_ns = 0;  // wall clock of the sender
};

struct OdometrySample {
  std::string agent;
  Odometry odometry;
};

// The argument must have passed problem_with() (checks.h).
[[nodiscard]] Bytes encode(const PlaceAdvert& advert);
[[nodiscard]] Bytes encode(const PeerKeyframe& keyframe);
[[nodiscard]] Bytes encode(const FullPeerKeyframe& message);
[[nodiscard]] Bytes encode(const StatusSample& sample);
[[nodiscard]] Bytes encode(const OdometrySample& sample);

[[nodiscard]] Decoded<PlaceAdvert> decode_place_advert(const Bytes& bytes);
[[nodiscard]] Decoded<PeerKeyframe> decode_peer_keyframe(const Bytes& bytes);
[[nodiscard]] Decoded<FullPeerKeyframe> decode_full_keyframe(const Bytes& bytes);
[[nodiscard]] Decoded<StatusSample> decode_status(const Bytes& bytes);
// The drone whose status it is; empty if it cannot be read.
[[nodiscard]] std::string key_of_status(const Bytes& bytes);
[[nodiscard]] Decoded<OdometrySample> decode_odometry(const Bytes& bytes);

}  // namespace covey
