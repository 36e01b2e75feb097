// SPDX-License-Identifier: Apache-2.0
#include "comms/own_addresses.h"

#include <ifaddrs.h>

#include <algorithm>

namespace covey {
namespace {

using std::chrono::steady_clock;

std::vector<in_addr_t> addresses_now() {
  std::vector<in_addr_t> out;
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0) return out;  // none but the loopback
  for (const ifaddrs* at = first; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_addr->sa_family != AF_INET) continue;
    out.push_back(reinterpret_cast<const sockaddr_in*>(at->ifa_addr)->sin_addr.s_addr);
  }
  freeifaddrs(first);
  return out;
}

}  // namespace

bool OwnAddresses::contain(in_addr address) {
  constexpr std::chrono::seconds kGoodFor{1};
  if (ntohl(address.s_addr) >> 24 == IN_LOOPBACKNET) return true;
  const std::lock_guard lock(mutex_);
  const auto now = steady_clock::now();
  if (addresses_.empty() || now - asked_ > kGoodFor) {
    addresses_ = addresses_now();
    asked_ = now;
  }
  return std::find(addresses_.begin(), addresses_.end(), address.s_addr) != addresses_.end();
}

}  // namespace covey
