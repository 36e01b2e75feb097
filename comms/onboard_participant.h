// SPDX-License-Identifier: Apache-2.0
//
// The DDS side of what goes on aboard one drone, apart from the radio's: other programs of the same
// computer, as ROS 2 and PX4's agent are. Inside this room only.
//
//   UDP only: Fast DDS's shared memory is not the same from one of its versions to the next, and
//     other vendors have none of it.
//   This computer's programs alone are heard and spoken to (checked_transport.h), whichever of its
//     addresses they use. They are looked for at the first ports of the domain on 127.0.0.1, where
//     Fast DDS listens, and by multicast over the loopback, which Cyclone DDS hears. A whitelist of
//     127.0.0.1 would not do: Fast DDS 2.9 then finds nobody who tells of an address of the
//     network.
//   Readers are best effort by default: they hear every writer.
//   Malformed packets are stopped before DDS sees them (rtps_check.h): it runs in the process that
//     flies the drone.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "comms/convert.h"

namespace eprosima::fastdds::dds {
class DataWriter;
}  // namespace eprosima::fastdds::dds

namespace covey {

struct OnboardNetwork {
  int domain = 0;             // ROS_DOMAIN_ID, 0..200
  bool loopback_only = true;  // this computer's programs alone; otherwise all, by multicast
};

enum class Keep {
  kNewest,  // who does not keep up loses samples, and holds nobody up
  kAll,     // a full history waits for the slowest reader
};

// As long as its participant.
class OnboardWriter {
 public:
  bool send(Bytes bytes);  // false: not taken within five seconds
  [[nodiscard]] int readers() const;
  [[nodiscard]] bool wait_until_received(std::chrono::milliseconds patience);

 private:
  friend class OnboardParticipant;
  explicit OnboardWriter(eprosima::fastdds::dds::DataWriter* writer) : writer_(writer) {}
  eprosima::fastdds::dds::DataWriter* writer_;
};

// `topic` as ROS 2 names it, with or without the slash before it; `type` as it is on the wire.
struct OnboardTopic {
  std::string topic, type;
  std::size_t max_bytes = 0;
};

// The policy of delivery, by which best effort differs from reliable.
inline constexpr char kReliability[] = "reliability";

class OnboardParticipant {
 public:
  // Throws std::runtime_error that says what to do, as the others do.
  explicit OnboardParticipant(const OnboardNetwork& network);
  ~OnboardParticipant();
  OnboardParticipant(const OnboardParticipant&) = delete;
  OnboardParticipant& operator=(const OnboardParticipant&) = delete;

  // `received` runs on a thread of DDS; so does `unheard`, when a writer does not offer what is
  // asked for: it is told by which policy.
  void read(const OnboardTopic& topic, bool reliable, std::function<void(const Bytes&)> received,
            std::function<void(const std::string& policy)> unheard);
  [[nodiscard]] OnboardWriter write(const OnboardTopic& topic, Keep keep);
  [[nodiscard]] std::uint64_t malformed_packets() const;  // that came and were stopped

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
