// SPDX-License-Identifier: Apache-2.0
#include "apps/drone_network.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <net/route.h>
#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <exception>
#include <fstream>
#include <mutex>
#include <queue>
#include <stdexcept>
#include <thread>
#include <utility>

#include "apps/process_usage.h"

namespace covey {
namespace {

constexpr char kDevice[] = "eth0";
constexpr char kNetmask[] = "255.255.255.0";
constexpr std::size_t kMacBytes = 6;
constexpr std::size_t kMaxFrameBytes = 2048;

using Mac = std::array<std::uint8_t, kMacBytes>;

Mac mac_of(std::size_t drone) {
  return {0x02, 0, 0, 0, 0, static_cast<std::uint8_t>(drone + 1)};  // locally administered
}

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error("a network namespace cannot be made: " + what + ": " +
                           std::strerror(errno));
}

void set_address(sockaddr& out, const std::string& text) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, text.c_str(), &address.sin_addr);
  std::memcpy(&out, &address, sizeof(address));
}

ifreq request_for(const char* device) {
  ifreq request{};
  std::strncpy(static_cast<char*>(request.ifr_name), device, IFNAMSIZ - 1);
  return request;
}

FileDescriptor open_tap() {
  FileDescriptor tap(open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC));
  if (tap.get() < 0) fail("/dev/net/tun");
  ifreq request = request_for(kDevice);
  request.ifr_flags = IFF_TAP | IFF_NO_PI;
  if (ioctl(tap.get(), TUNSETIFF, &request) != 0) fail("a TAP device");
  return tap;
}

// The settings of devices in the calling thread's namespace.
class Devices {
 public:
  Devices() : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    if (socket_.get() < 0) fail("a socket");
  }

  void set_mac(const Mac& mac) const {
    ifreq request = request_for(kDevice);
    request.ifr_hwaddr.sa_family = ARPHRD_ETHER;
    std::copy(mac.begin(), mac.end(), static_cast<char*>(request.ifr_hwaddr.sa_data));
    call(SIOCSIFHWADDR, &request, "its hardware address");
  }

  void set_ip(const std::string& address) const {
    ifreq request = request_for(kDevice);
    set_address(request.ifr_addr, address);
    call(SIOCSIFADDR, &request, "its address");
    set_address(request.ifr_netmask, kNetmask);
    call(SIOCSIFNETMASK, &request, "its netmask");
  }

  void bring_up(const char* device) const {
    ifreq request = request_for(device);
    call(SIOCGIFFLAGS, &request, device);
    request.ifr_flags = static_cast<short>(request.ifr_flags | IFF_UP);
    call(SIOCSIFFLAGS, &request, device);
  }

  // Multicast leaves by the only device there is.
  void add_multicast_route() const {
    std::string device = kDevice;
    rtentry route{};
    set_address(route.rt_dst, "224.0.0.0");
    set_address(route.rt_genmask, "240.0.0.0");
    route.rt_flags = RTF_UP;
    route.rt_dev = device.data();
    call(SIOCADDRT, &route, "the multicast route");
  }

  void add_neighbour(const std::string& address, const Mac& mac) const {
    arpreq neighbour{};
    set_address(neighbour.arp_pa, address);
    neighbour.arp_ha.sa_family = ARPHRD_ETHER;
    std::copy(mac.begin(), mac.end(), static_cast<char*>(neighbour.arp_ha.sa_data));
    neighbour.arp_flags = ATF_PERM | ATF_COM;
    std::strncpy(static_cast<char*>(neighbour.arp_dev), kDevice, sizeof(neighbour.arp_dev) - 1);
    call(SIOCSARP, &neighbour, "a neighbour");
  }

 private:
  template <typename Argument>
  void call(unsigned long request, Argument* argument, const std::string& what) const {
    if (ioctl(socket_.get(), request, argument) != 0) fail(what);
  }

  FileDescriptor socket_;
};

// Nobody uses it here, and its chatter would be counted. Absent where the kernel has none.
void disable_ipv6() { std::ofstream("/proc/sys/net/ipv6/conf/all/disable_ipv6") << "1"; }

// On a thread that is thrown away: the namespace is the thread's, not the process's.
DroneNamespace make_here(std::size_t drone, std::size_t drones) {
  if (unshare(CLONE_NEWNET) != 0) fail("unshare");
  disable_ipv6();
  DroneNamespace made;
  made.network = FileDescriptor(open("/proc/thread-self/ns/net", O_RDONLY | O_CLOEXEC));
  if (made.network.get() < 0) fail("/proc/thread-self/ns/net");
  made.tap = open_tap();
  const Devices devices;
  devices.set_mac(mac_of(drone));
  devices.set_ip(drone_address(drone));
  devices.bring_up("lo");
  devices.bring_up(kDevice);
  devices.add_multicast_route();
  for (std::size_t other = 0; other < drones; ++other) {
    if (other != drone) devices.add_neighbour(drone_address(other), mac_of(other));
  }
  return made;
}

}  // namespace

std::optional<std::string> why_no_namespaces() {
  if (geteuid() != 0) return "network namespaces need root on Linux (try sudo)";
  if (access("/dev/net/tun", R_OK | W_OK) != 0) {
    return "/dev/net/tun cannot be used here: load the module tun, or give it to the container";
  }
  return std::nullopt;
}

std::string drone_address(std::size_t drone) { return "10.77.0." + std::to_string(drone + 1); }

DroneNamespace make_drone_namespace(std::size_t drone, std::size_t drones) {
  DroneNamespace made;
  std::exception_ptr failure;
  std::thread([&] {
    try {
      made = make_here(drone, drones);
    } catch (...) {
      failure = std::current_exception();
    }
  }).join();
  if (failure) std::rethrow_exception(failure);
  return made;
}

// ---------------------------------------------------------------------------------- frame switch

class FrameSwitch::Impl {
 public:
  Impl(std::vector<FileDescriptor> taps, LinkModel model)
      : taps_(std::move(taps)),
        model_(std::move(model)),
        wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
        counts_(taps_.size()) {
    if (wake_.get() < 0) fail("eventfd");
    thread_ = std::thread([this] { run(); });
  }
  ~Impl() {
    const std::uint64_t stop = 1;
    // Cannot fail: the counter is far from full.
    (void)!write(wake_.get(), &stop, sizeof(stop));
    thread_.join();
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  void begin_flight(double start_ms, double pace) {
    const std::lock_guard lock(mutex_);
    model_.begin_flight(start_ms * 1e-3, pace);
  }

  [[nodiscard]] std::vector<PortCounts> counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
  }

 private:
  using Frame = std::vector<std::uint8_t>;

  // On its way to one drone.
  struct Delivery {
    double due_s = 0;
    std::uint64_t order = 0;  // of those due at once
    std::size_t to = 0;
    std::shared_ptr<const Frame> frame;  // one for all receivers of a broadcast
  };
  struct Later {
    bool operator()(const Delivery& a, const Delivery& b) const {
      return a.due_s != b.due_s ? a.due_s > b.due_s : a.order > b.order;
    }
  };

  void run() {
    std::vector<pollfd> inputs{{wake_.get(), POLLIN, 0}};
    for (const FileDescriptor& tap : taps_) inputs.push_back({tap.get(), POLLIN, 0});
    while (true) {
      wait(inputs);
      if ((inputs.front().revents & POLLIN) != 0) return;
      for (std::size_t i = 0; i < taps_.size(); ++i) {
        if ((inputs[i + 1].revents & POLLIN) != 0) take_frames(i);
      }
      deliver();
    }
  }

  // Until a frame comes in or one is due.
  void wait(std::vector<pollfd>& inputs) {
    timespec patience{};
    if (!due_.empty()) {
      const double left_s = std::max(0.0, due_.top().due_s - steady_ms() * 1e-3);
      patience.tv_sec = static_cast<time_t>(left_s);
      patience.tv_nsec = static_cast<long>(1e9 * (left_s - std::floor(left_s)));
    }
    for (pollfd& input : inputs) input.revents = 0;
    ppoll(inputs.data(), inputs.size(), due_.empty() ? nullptr : &patience, nullptr);
  }

  void take_frames(std::size_t from) {
    constexpr int kAtOnce = 32;  // then the others get their turn
    std::array<std::uint8_t, kMaxFrameBytes> buffer{};
    for (int i = 0; i < kAtOnce; ++i) {
      const ssize_t size = read(taps_[from].get(), buffer.data(), buffer.size());
      if (size < static_cast<ssize_t>(2 * kMacBytes)) return;
      route(from, std::make_shared<const Frame>(buffer.begin(), buffer.begin() + size));
    }
  }

  void route(std::size_t from, const std::shared_ptr<const Frame>& frame) {
    const std::lock_guard lock(mutex_);
    counts_[from].frames_sent += 1;
    counts_[from].bytes_sent += frame->size();
    const bool to_all = (frame->front() & 1) != 0;  // broadcast or multicast
    for (std::size_t to = 0; to < taps_.size(); ++to) {
      if (to == from) continue;
      const Mac mac = mac_of(to);
      if (to_all || std::equal(mac.begin(), mac.end(), frame->begin())) offer(from, to, frame);
    }
  }

  void offer(std::size_t from, std::size_t to, const std::shared_ptr<const Frame>& frame) {
    const FrameVerdict verdict = model_.offer(steady_ms() * 1e-3, from, to, frame->size());
    PortCounts& counts = counts_[from];
    switch (verdict.fate) {
      case FrameFate::kDelivered:
        ++counts.delivered;
        due_.push({verdict.arrives_s, order_++, to, frame});
        break;
      case FrameFate::kLost:
        ++counts.lost;
        break;
      case FrameFate::kQueueFull:
        ++counts.queue_full;
        break;
      case FrameFate::kCut:
        ++counts.cut;
        break;
    }
  }

  void deliver() {
    const double now_s = steady_ms() * 1e-3;
    while (!due_.empty() && due_.top().due_s <= now_s) {
      const Delivery& next = due_.top();
      // A drone whose queue is full loses the frame, as it would with a real device.
      (void)!write(taps_[next.to].get(), next.frame->data(), next.frame->size());
      due_.pop();
    }
  }

  const std::vector<FileDescriptor> taps_;
  mutable std::mutex mutex_;  // model_ and counts_
  LinkModel model_;
  FileDescriptor wake_;
  std::vector<PortCounts> counts_;
  std::priority_queue<Delivery, std::vector<Delivery>, Later> due_;
  std::uint64_t order_ = 0;
  std::thread thread_;
};

FrameSwitch::FrameSwitch(std::vector<FileDescriptor> taps, LinkModel model)
    : impl_(std::make_unique<Impl>(std::move(taps), std::move(model))) {}
FrameSwitch::~FrameSwitch() = default;

void FrameSwitch::begin_flight(double start_ms, double pace) {
  impl_->begin_flight(start_ms, pace);
}

std::vector<PortCounts> FrameSwitch::counts() const { return impl_->counts(); }

DroneNetwork::DroneNetwork(const NetworkModel& model, std::uint64_t seed) {
  if (const auto why = why_no_namespaces()) throw std::runtime_error(*why);
  std::vector<FileDescriptor> taps;
  for (std::size_t drone = 0; drone < model.drones; ++drone) {
    DroneNamespace made = make_drone_namespace(drone, model.drones);
    namespaces_.push_back(std::move(made.network));
    taps.push_back(std::move(made.tap));
  }
  switch_ = std::make_unique<FrameSwitch>(std::move(taps), LinkModel(model, seed));
}

}  // namespace covey
