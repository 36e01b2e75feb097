// SPDX-License-Identifier: Apache-2.0
//
// A driver of a camera as ROS 2 starts one on Fast DDS: a participant with that library's defaults.
// Says a small image every 10 ms and tells of the odometry that it hears, one line of JSON each.
//   covey_ordinary_driver DOMAIN             until its standard input ends
//   covey_ordinary_driver DOMAIN localhost   as ROS_LOCALHOST_ONLY makes it: 127.0.0.1 alone
//   covey_ordinary_driver DOMAIN ADDRESS     looks for others there as well
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <iostream>
#include <stdexcept>
#include <string>

#include "comms/byte_type.h"
#include "comms/dds_owners.h"
#include "comms/onboard_topics.h"
#include "tests/comms/input_ended.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::types::ReturnCode_t;

constexpr int kPeriod_ms = 10;

template <typename Entity>
Entity* require(Entity* entity, const std::string& what) {
  if (entity == nullptr) throw std::runtime_error("no " + what);
  return entity;
}

// Others are looked for at all ports where a drone may be.
dds::DomainParticipantQos participant_qos(const std::string& where) {
  constexpr std::uint32_t kPorts = 64;
  dds::DomainParticipantQos qos;
  if (where.empty()) return qos;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<UDPv4TransportDescriptor>();
  udp->maxInitialPeersRange = kPorts;
  qos.transport().user_transports.push_back(udp);
  if (where == "localhost") {
    udp->interfaceWhiteList = {"127.0.0.1"};
    return qos;
  }
  Locator_t locator;
  IPLocator::setIPv4(locator, where);
  qos.wire_protocol().builtin.initialPeersList.push_back(locator);
  return qos;
}

class Driver {
 public:
  Driver(int domain, const std::string& where)
      : participant_(require(dds::DomainParticipantFactory::get_instance()->create_participant(
                                 static_cast<dds::DomainId_t>(domain), participant_qos(where)),
                             "participant")),
        publisher_(create_publisher(*participant_)),
        images_(require(publisher_->create_datawriter(topic("rt/", image_topic("camera/image_raw")),
                                                      dds::DATAWRITER_QOS_DEFAULT),
                        "writer")),
        odometry_(require(participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT)
                              ->create_datareader(topic("rt/", nav_odometry_topic("odometry")),
                                                  dds::DATAREADER_QOS_DEFAULT),
                          "reader")) {}

  void say() {
    constexpr int kSide = 64;
    stamp_ns_ += TimeNs{kPeriod_ms} * 1'000'000;
    ByteSample sample{encode(CameraImage{
        stamp_ns_, kSide, kSide, 1, std::vector<std::uint8_t>(std::size_t{kSide} * kSide, 77)})};
    images_->write(&sample);
  }

  void hear() {
    ByteSample sample;
    dds::SampleInfo info;
    while (odometry_->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK)
      std::cout << R"({"topic":"nav"})" << std::endl;
  }

 private:
  dds::Topic* topic(const std::string& prefix, const OnboardTopic& topic) {
    const dds::TypeSupport type(new ByteType(topic.type, topic.max_bytes));
    type.register_type(participant_.get());
    return require(
        participant_->create_topic(prefix + topic.topic, topic.type, dds::TOPIC_QOS_DEFAULT),
        "topic");
  }

  ParticipantOwner participant_;
  PublisherOwner publisher_;
  // Owned by these two.
  dds::DataWriter* images_;
  dds::DataReader* odometry_;
  TimeNs stamp_ns_ = 5'000'000'000;
};

}  // namespace
}  // namespace covey

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) return 2;
  try {
    covey::Driver driver(std::atoi(argv[1]), argc == 3 ? argv[2] : "");
    std::cout << R"({"topic":"ready"})" << std::endl;
    while (!covey::input_ended(covey::kPeriod_ms)) {
      driver.say();
      driver.hear();
    }
  } catch (const std::exception& error) {
    std::cerr << "covey_ordinary_driver: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
