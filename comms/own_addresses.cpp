// SPDX-License-Identifier: Apache-2.0
#include "comms/own_addresses.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>

#include <algorithm>
#include <array>
#include <memory>

namespace covey {
namespace {

using std::chrono::steady_clock;

// Calls `use(address, flags of its interface)`. Where the system does not tell, none.
template <typename Use>
void for_each_address(const Use& use) {
  ifaddrs* first = nullptr;
  if (getifaddrs(&first) != 0) return;
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(first, freeifaddrs);
  for (const ifaddrs* at = first; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_addr->sa_family != AF_INET) continue;
    use(reinterpret_cast<const sockaddr_in*>(at->ifa_addr)->sin_addr, at->ifa_flags);
  }
}

std::vector<in_addr_t> addresses_now() {
  std::vector<in_addr_t> out;
  for_each_address([&](in_addr address, unsigned /*flags*/) { out.push_back(address.s_addr); });
  return out;
}

}  // namespace

std::vector<OwnAddress> own_addresses() {
  constexpr unsigned kRunning = IFF_UP | IFF_RUNNING;
  std::vector<OwnAddress> out;
  for_each_address([&](in_addr address, unsigned flags) {
    std::array<char, INET_ADDRSTRLEN> text{};
    if (inet_ntop(AF_INET, &address, text.data(), text.size()) != nullptr)
      out.push_back({text.data(), (flags & kRunning) == kRunning});
  });
  return out;
}

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
