// SPDX-License-Identifier: Apache-2.0
#include "comms/byte_type.h"

#include <cstring>
#include <exception>
#include <memory>

namespace covey {

using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

ByteType::ByteType(const std::string& name, std::size_t max_bytes) : max_bytes_(max_bytes) {
  setName(name.c_str());
  m_typeSize = static_cast<std::uint32_t>(max_bytes);
  auto_fill_type_object(false);
  auto_fill_type_information(false);
}

bool ByteType::serialize(void* data, SerializedPayload_t* payload) {
  const Bytes& bytes = static_cast<const ByteSample*>(data)->bytes;
  if (bytes.size() < 4 || bytes.size() > payload->max_size) return false;
  std::memcpy(payload->data, bytes.data(), bytes.size());
  payload->length = static_cast<std::uint32_t>(bytes.size());
  payload->encapsulation = bytes[1];
  return true;
}

bool ByteType::deserialize(SerializedPayload_t* payload, void* data) {
  if (payload->data == nullptr || payload->length > max_bytes_) return false;
  try {
    static_cast<ByteSample*>(data)->bytes.assign(payload->data, payload->data + payload->length);
  } catch (const std::exception&) {
    return false;  // out of memory: the sample is lost, the drone is not
  }
  return true;
}

std::function<std::uint32_t()> ByteType::getSerializedSizeProvider(void* data) {
  const auto size = static_cast<std::uint32_t>(static_cast<const ByteSample*>(data)->bytes.size());
  return [size] { return size; };
}

// DDS's interface deals in raw pointers and pairs these two itself.
void* ByteType::createData() { return std::make_unique<ByteSample>().release(); }

void ByteType::deleteData(void* data) {
  std::unique_ptr<ByteSample> owner(static_cast<ByteSample*>(data));
}

bool ByteType::getKey(void* /*data*/, InstanceHandle_t* /*handle*/, bool /*force_md5*/) {
  return false;
}

}  // namespace covey
