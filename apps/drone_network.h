// SPDX-License-Identifier: Apache-2.0
//
// Network namespaces, one for each drone, and a switch of ours between them.
//
// Nothing of it has a name in the file system: a namespace and the device in it exist as long as
// somebody holds their descriptors or runs inside. The system takes them away with the last one,
// however this program ends, so there is nothing to clean up after a crash.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/file_descriptor.h"
#include "sim/link_model.h"

namespace covey {

// Why namespaces cannot be made here; nothing when they can.
[[nodiscard]] std::optional<std::string> why_no_namespaces();

// "10.77.0.<drone + 1>"
[[nodiscard]] std::string drone_address(std::size_t drone);

// A namespace with a loopback and `eth0`, a TAP device whose frames come out of `tap`. Every drone
// knows the others' hardware addresses: what is measured is DDS, not ARP.
struct DroneNamespace {
  FileDescriptor network;  // to enter it: setns
  FileDescriptor tap;      // one frame for each read or write; does not block
};

// Throws std::runtime_error. `drones`: in the whole network.
[[nodiscard]] DroneNamespace make_drone_namespace(std::size_t drone, std::size_t drones);

// What became of one drone's frames. Bytes are whole Ethernet frames; what goes to several drones
// counts once when sent, and for each when delivered or not.
struct PortCounts {
  std::uint64_t frames_sent = 0, bytes_sent = 0;
  std::uint64_t delivered = 0, lost = 0, queue_full = 0, cut = 0;  // frames, of those sent
};

// Carries frames between the drones, as the model says, on a thread of its own.
class FrameSwitch {
 public:
  FrameSwitch(std::vector<FileDescriptor> taps, LinkModel model);
  ~FrameSwitch();
  FrameSwitch(const FrameSwitch&) = delete;
  FrameSwitch& operator=(const FrameSwitch&) = delete;

  // See LinkModel::begin_flight; from `start_ms` on, of steady_ms().
  void begin_flight(double start_ms, double pace);

  [[nodiscard]] std::vector<PortCounts> counts() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// All of it: made in the constructor, gone with the object.
class DroneNetwork {
 public:
  DroneNetwork(const NetworkModel& model, std::uint64_t seed);

  [[nodiscard]] int namespace_of(std::size_t drone) const { return namespaces_[drone].get(); }
  [[nodiscard]] FrameSwitch& frames() { return *switch_; }

 private:
  std::vector<FileDescriptor> namespaces_;
  std::unique_ptr<FrameSwitch> switch_;
};

}  // namespace covey
