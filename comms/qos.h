// SPDX-License-Identifier: Apache-2.0
//
// From a link's profile to the QoS of Fast DDS. What a profile chooses, and why, stands in
// link_profiles.json; what holds for all of them is here.
//
//   One answer topic per receiver, so that the others' radios stay silent: measured, wire x1.16 at
//     the publisher; a shared topic with filtering readers x3.44 with four drones.
//   UDP only. Shared memory leaves segments behind when a process is killed, and 10 kB/s do not
//     need it.
//   Bounded memory everywhere: number of participants, endpoints, samples and the size of a sample,
//     because a hostile packet may claim any of them.
//   Odometry: nothing on board depends on who listens.
#pragma once

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <chrono>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <memory>
#include <string>
#include <vector>

#include "comms/counting_transport.h"
#include "comms/link_state.h"
#include "comms/peer_link.h"

namespace covey {

[[nodiscard]] eprosima::fastrtps::Duration_t duration(std::chrono::milliseconds time);

// The ports of that participant, from 0, or the next free ones: Fast DDS tries them in turn. Left
// to itself, it would count participants per process, and a link that was renewed often enough
// would sit on a port where nobody looks.
void sit_on_ports_from(int participant, const std::vector<std::string>& addresses, int domain,
                       eprosima::fastdds::dds::WireProtocolConfigQos& wire);

// Whether a link whose first port is that one has opened it: Fast DDS goes on without a socket when
// none of the ports that it tries is to be had, and names the one after them.
[[nodiscard]] bool is_heard_at(std::uint32_t port, const LinkConfig& config);

// Drones with the same settings look for others at that port, if they have to.
[[nodiscard]] bool is_looked_at(std::uint32_t port, const LinkConfig& config);

[[nodiscard]] std::shared_ptr<eprosima::fastdds::rtps::UDPv4TransportDescriptor> udp_transport(
    const LinkConfig& config);

[[nodiscard]] eprosima::fastdds::dds::DomainParticipantQos participant_qos(
    const LinkConfig& config, const std::shared_ptr<Wire>& wire);

[[nodiscard]] eprosima::fastdds::dds::DataWriterQos writer_qos(Kind kind, const LinkConfig& config);

[[nodiscard]] eprosima::fastdds::dds::DataReaderQos reader_qos(Kind kind, const LinkConfig& config);

}  // namespace covey
