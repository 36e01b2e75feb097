// SPDX-License-Identifier: Apache-2.0
//
// Owns a participant of DDS with all that was made of it. Inside this room only.
#pragma once

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <memory>

namespace covey {

struct ParticipantDeleter {
  void operator()(eprosima::fastdds::dds::DomainParticipant* participant) const {
    participant->set_listener(nullptr);
    participant->delete_contained_entities();
    eprosima::fastdds::dds::DomainParticipantFactory::get_instance()->delete_participant(
        participant);
  }
};
using ParticipantOwner =
    std::unique_ptr<eprosima::fastdds::dds::DomainParticipant, ParticipantDeleter>;

}  // namespace covey
