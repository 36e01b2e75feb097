// SPDX-License-Identifier: Apache-2.0
//
// The IPv4 addresses of this computer, which may come and go.
#pragma once

#include <netinet/in.h>

#include <chrono>
#include <mutex>
#include <string>
#include <vector>

namespace covey {

struct OwnAddress {
  std::string address;
  bool running = false;  // its interface is up and has a carrier
};

// Now, those of the loopback among them.
[[nodiscard]] std::vector<OwnAddress> own_addresses();

// Asks the system once a second at most. Thread-safe.
class OwnAddresses {
 public:
  // All of 127.0.0.0/8 are among them.
  [[nodiscard]] bool contain(in_addr address);

 private:
  std::mutex mutex_;
  std::vector<in_addr_t> addresses_;
  std::chrono::steady_clock::time_point asked_;
};

}  // namespace covey
