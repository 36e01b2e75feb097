// SPDX-License-Identifier: Apache-2.0
//
// A DDS type whose samples are serialised bytes. Generated type support would decode inside the
// middleware, where a bad encapsulation header or length escapes as an exception and ends the
// process. Here DDS only copies a bounded block; convert.h decodes it where a refusal has a reason
// and a peer to blame. It also makes payload sizes exact, in both directions.
//
// Of a keyed topic, DDS asks for the key of every sample that brings none, before anybody has
// checked it, and generated code aborts on one that cannot be read. Here such a sample has the
// empty key: it arrives, and is refused where the others are.
#pragma once

#include <cstddef>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <string>

#include "comms/convert.h"

namespace covey {

struct ByteSample {
  Bytes bytes;  // encapsulation header and message
};

// The key of a sample, whatever its bytes are.
using KeyOf = std::string (*)(const Bytes& bytes);

class ByteType : public eprosima::fastdds::dds::TopicDataType {
 public:
  // `name` is the IDL type's, so that others' implementations match; so must the key be: the one
  // string that the IDL marks, or none.
  ByteType(const std::string& name, std::size_t max_bytes, KeyOf key_of = nullptr);

  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override;
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override;
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override;
  void* createData() override;
  void deleteData(void* data) override;
  bool getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle,
              bool force_md5) override;

 private:
  std::size_t max_bytes_;
  KeyOf key_of_;
};

}  // namespace covey
