// SPDX-License-Identifier: Apache-2.0
//
// Every choice of quality of service, with its reason. Measured over links that lose 10..30 % of
// their packets, 20 ms one way; "wire" is bytes on the link per delivered payload byte.
//
// All topics
//   UDP datagrams of at most 1400 bytes: a sample that fits one is lost or not, and never
//   fragmented
//     by IP. Larger samples are fragmented by RTPS, which can ask for single fragments again.
//   Unicast discovery on 127.0.0.1, or between given hosts: radios do not repair multicast and send
//     it slowly. Multicast only if no host is given.
//   No shared memory: a killed process leaves segments behind, and 10 kB/s do not need it.
//   Bounded memory everywhere: number of participants, endpoints, samples and the size of a sample,
//     because a hostile packet may claim any of them.
// request (2 kB to everybody): reliable with a history of 8, else nothing is left to repair (depth
// 1
//   repairs nothing: 68 % at 20 % loss; this: 99 %, wire x1.76). It expires after 200 ms: a place
//   that was passed is not worth asking about. Heartbeat every 40 ms, answered within 5 ms: a
//   repair fits into the lifespan several times.
// message (kilobytes to one drone): one topic per receiver, so that the others' radios stay silent
//   (wire x1.16; a shared topic with filtering readers x3.44 with four drones). Reliable, history
//   of 4, heartbeats not piggybacked: they would be sent with every fragment and be answered by a
//   storm of requests for fragments that are still under way. No lifespan: landmarks do not move.
// full_message (hundreds of kilobytes): as message; larger socket buffers, else those of a few
// drones at once overflow them and everything is sent twice.
// status (a state, not an event): the last one of each drone is kept for late joiners. Liveliness
//   of 1.5 s tells a dead drone from a quiet one; its participant is forgotten after 4 s.
// odometry: best effort, the newest only. Nothing on board depends on who listens.
//
// LinkProfile::kLockstep, for runs that must be the same on every machine: request and message keep
// every sample until all have acknowledged it, nothing expires, a full history blocks the sender,
// and leases are long enough for a machine that is busy with other things.
#pragma once

#include <chrono>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <memory>

#include "comms/counting_transport.h"
#include "comms/link_state.h"
#include "comms/peer_link.h"

namespace covey {

[[nodiscard]] eprosima::fastrtps::Duration_t duration(std::chrono::milliseconds time);

[[nodiscard]] eprosima::fastdds::dds::DomainParticipantQos participant_qos(
    const LinkConfig& config, const std::shared_ptr<WireCounters>& counters);

[[nodiscard]] eprosima::fastdds::dds::DataWriterQos writer_qos(Kind kind, const LinkConfig& config);

[[nodiscard]] eprosima::fastdds::dds::DataReaderQos reader_qos(Kind kind, const LinkConfig& config);

}  // namespace covey
