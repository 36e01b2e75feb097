// SPDX-License-Identifier: Apache-2.0
#include "comms/dds_log.h"

#include <fastdds/dds/log/Log.hpp>
#include <memory>
#include <mutex>

namespace covey {
namespace {

using eprosima::fastdds::dds::Log;
using eprosima::fastdds::dds::LogConsumer;

struct KeptErrors {
  std::mutex mutex;
  DdsErrors errors;
};

// Never destroyed: Fast DDS's log thread may speak until the very end of the process.
KeptErrors& kept() {
  static KeptErrors* const errors = std::make_unique<KeptErrors>().release();
  return *errors;
}

class Keeper : public LogConsumer {
 public:
  void Consume(const Log::Entry& entry) override {
    if (entry.kind != Log::Kind::Error) return;
    const std::lock_guard lock(kept().mutex);
    ++kept().errors.count;
    kept().errors.last = entry.message;
  }
};

}  // namespace

void keep_dds_errors() {
  static std::once_flag once;
  std::call_once(once, [] {
    Log::SetVerbosity(Log::Kind::Error);
    Log::ClearConsumers();
    Log::RegisterConsumer(std::make_unique<Keeper>());
  });
}

DdsErrors dds_errors() {
  Log::Flush();
  const std::lock_guard lock(kept().mutex);
  return kept().errors;
}

}  // namespace covey
