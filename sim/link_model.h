// SPDX-License-Identifier: Apache-2.0
//
// What radio links do to frames: loss, bursts of loss, delay, jitter, a rate with its queue,
// partitions, and quality that follows the distance between drones. Clocks are passed in and every
// link draws from a stream of its own: the same frames at the same times meet the same fate,
// whatever happens on other links.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <utility>
#include <vector>

#include "sim/random.h"

namespace covey {

struct LinkQuality {
  double loss = 0;  // share of frames, below 1
  // Frames lost in a row on average (Gilbert, 1960: a good state that loses nothing, a bad one that
  // loses all). Not below 1 / (1 - loss), which is that of losses independent of each other.
  double mean_burst = 1;
  double delay_s = 0;
  double jitter_s = 0;        // up to so much more, uniform; frames of a link keep their order
  double rate_bit_per_s = 0;  // 0: without limit
  double queue_s = 0.2;       // a frame that would wait longer for its turn is dropped
};

// Log-distance path loss and a logistic packet error rate give loss = x / (1 + x) with
// x = (distance / half_range)^steepness; both losses count, one after the other.
struct RadioRange {
  double half_range_m = 0;  // where half of the frames are lost; 0: distance does not matter
  double steepness = 6;
};

// Nothing passes between these drones and all others. Seconds of the flight.
struct Partition {
  double from_s = 0, until_s = 0;
  std::vector<std::size_t> apart;
};

struct NetworkModel {
  std::size_t drones = 0;
  LinkQuality quality;  // of every link that is not among these, by sender and receiver:
  std::map<std::pair<std::size_t, std::size_t>, LinkQuality> special;
  RadioRange range;
  // At a second of the flight. Only called when `range` needs it.
  std::function<double(std::size_t, std::size_t, double)> distance_m;
  std::vector<Partition> partitions;
};

enum class FrameFate : std::uint8_t { kDelivered, kLost, kQueueFull, kCut };

struct FrameVerdict {
  FrameFate fate = FrameFate::kDelivered;
  double arrives_s = 0;  // if delivered
};

class LinkModel {
 public:
  LinkModel(NetworkModel network, std::uint64_t seed);

  // The flight starts, at `pace` times real time: partitions and distances follow it from now on.
  // Before, there are no partitions and everybody is where the flight starts.
  void begin_flight(double now_s, double pace);

  // A frame of so many bytes. `now_s` does not decrease.
  [[nodiscard]] FrameVerdict offer(double now_s, std::size_t from, std::size_t to,
                                   std::size_t bytes);

 private:
  struct Link {
    Random random;
    bool bad = false;      // state of the burst model
    double free_at_s = 0;  // when the last accepted frame has left
    double last_arrival_s = 0;
  };

  [[nodiscard]] double flight_time_s(double now_s) const;
  [[nodiscard]] bool cut(std::size_t from, std::size_t to, double now_s) const;
  [[nodiscard]] double loss(const LinkQuality& quality, std::size_t from, std::size_t to,
                            double now_s) const;
  [[nodiscard]] const LinkQuality& quality_of(std::size_t from, std::size_t to) const;

  NetworkModel network_;
  std::vector<Link> links_;  // by sender, then receiver
  bool flying_ = false;
  double start_s_ = 0, pace_ = 1;
};

}  // namespace covey
