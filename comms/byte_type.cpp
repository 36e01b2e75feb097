// SPDX-License-Identifier: Apache-2.0
#include "comms/byte_type.h"

#include <fastrtps/utils/md5.h>

#include <cstring>
#include <exception>
#include <iterator>
#include <memory>

namespace covey {

using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

namespace {

// What a string's key hash is made of: CDR, big-endian.
Bytes key_bytes(const std::string& key) {
  const auto length = static_cast<std::uint32_t>(key.size() + 1);
  Bytes out;
  for (const int shift : {24, 16, 8, 0}) out.push_back(static_cast<std::uint8_t>(length >> shift));
  out.insert(out.end(), key.begin(), key.end());
  out.push_back(0);
  return out;
}

}  // namespace

ByteType::ByteType(const std::string& name, std::size_t max_bytes, KeyOf key_of)
    : max_bytes_(max_bytes), key_of_(key_of) {
  setName(name.c_str());
  m_typeSize = static_cast<std::uint32_t>(max_bytes);
  m_isGetKeyDefined = key_of != nullptr;
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

// A key that may be longer than 16 bytes is known by its MD5 (RTPS 2.2, 9.6.3.8).
bool ByteType::getKey(void* data, InstanceHandle_t* handle, bool /*force_md5*/) {
  if (key_of_ == nullptr) return false;
  try {
    Bytes bytes = key_bytes(key_of_(static_cast<const ByteSample*>(data)->bytes));
    MD5 md5;
    md5.update(bytes.data(), static_cast<unsigned int>(bytes.size()));
    md5.finalize();
    for (unsigned i = 0; i < std::size(md5.digest); ++i) handle->value[i] = md5.digest[i];
  } catch (const std::exception&) {
    return false;  // out of memory
  }
  return true;
}

}  // namespace covey
