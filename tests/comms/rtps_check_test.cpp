// SPDX-License-Identifier: Apache-2.0
#include "comms/rtps_check.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

namespace covey {
namespace {

using Datagram = std::vector<std::uint8_t>;

constexpr std::uint8_t kData = 0x15, kInfoTs = 0x09, kStatistics = 0x80;

Datagram message(const std::vector<Datagram>& submessages) {
  Datagram out = {'R', 'T', 'P', 'S', 2, 3, 1, 15};
  out.resize(20);
  for (const Datagram& part : submessages) out.insert(out.end(), part.begin(), part.end());
  return out;
}

// Little-endian, with as many bytes as it says.
Datagram submessage(std::uint8_t id, std::uint8_t length) {
  Datagram out = {id, 1, length, 0};
  out.resize(4U + length);
  return out;
}

bool accepts(const Datagram& datagram) { return is_rtps_message(datagram.data(), datagram.size()); }

TEST(RtpsCheck, WhatDronesSayPasses) {
  EXPECT_TRUE(accepts(message({})));
  EXPECT_TRUE(accepts(message({submessage(kInfoTs, 8), submessage(kData, 24)})));
  EXPECT_TRUE(accepts(message({submessage(kData, 24), submessage(kStatistics, 36)})));
  EXPECT_TRUE(accepts(message({{kData, 0, 0, 4, 1, 2, 3, 4}, submessage(kData, 8)})))
      << "big-endian";
  EXPECT_TRUE(accepts(message({submessage(kInfoTs, 0), submessage(kData, 7)})))
      << "the last one need not end at a multiple of four";
  EXPECT_TRUE(accepts(message({{kData, 1, 0, 0, 9, 9, 9}}))) << "length 0: up to the end";
}

TEST(RtpsCheck, WhatDoesNotFitIsStopped) {
  Datagram other = message({submessage(kData, 8)});
  other[0] = 'X';
  EXPECT_FALSE(accepts(other));
  EXPECT_FALSE(accepts({'R', 'T', 'P', 'S'}));
  EXPECT_FALSE(accepts(message({{kData, 1, 0}})));
  EXPECT_FALSE(accepts(message({{kData, 1, 5, 0, 1, 2, 3, 4}})));
  EXPECT_FALSE(accepts(message({{kData, 0, 4, 0, 1, 2, 3, 4}}))) << "1024, big-endian";
  EXPECT_FALSE(accepts(message({submessage(kData, 7), submessage(kData, 8)})));
}

TEST(RtpsCheck, StatisticsStandAtTheEndOrNowhere) {
  EXPECT_FALSE(accepts(message({submessage(kStatistics, 36), submessage(kData, 8)})));
  EXPECT_FALSE(accepts(message({submessage(kStatistics, 36), {0}})));
}

TEST(RtpsCheck, EveryTruncationIsReadWithinItsBounds) {
  const Datagram whole = message({submessage(kInfoTs, 8), submessage(kData, 24)});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Datagram cut(whole.begin(), whole.begin() + static_cast<long>(size));
    EXPECT_EQ(accepts(cut), size == 20 || size == 32) << size;
  }
}

Datagram data_of(std::array<std::uint8_t, 4> writer, std::uint8_t flags) {
  Datagram out = submessage(kData, 24);
  out[1] = flags;
  std::copy(writer.begin(), writer.end(), out.begin() + 12);
  return out;
}

constexpr std::array<std::uint8_t, 4> kAnnouncer = {0, 1, 0, 0xc2},
                                      kTopicAnnouncer = {0, 0, 3, 0xc2};
constexpr std::uint8_t kWithData = 0x05, kKeyOnly = 0x09;

bool announces(const Datagram& datagram) {
  return is_announcement(datagram.data(), datagram.size());
}

TEST(RtpsCheck, AnAnnouncementIsToldFromAllElse) {
  const Datagram announcement = data_of(kAnnouncer, kWithData);
  EXPECT_TRUE(announces(message({announcement})));
  EXPECT_TRUE(
      announces(message({submessage(kInfoTs, 8), announcement, submessage(kStatistics, 56)})));
  EXPECT_FALSE(announces(message({})));
  EXPECT_FALSE(announces(message({data_of(kAnnouncer, kKeyOnly)}))) << "a farewell";
  EXPECT_FALSE(announces(message({data_of(kTopicAnnouncer, kWithData)})));
  EXPECT_FALSE(announces(message({announcement, data_of(kTopicAnnouncer, kWithData)})));
  EXPECT_FALSE(announces(message({announcement, submessage(0x07, 28)}))) << "a heartbeat as well";
  const Datagram whole = message({announcement});
  for (std::size_t size = 20; size < 36; ++size)
    EXPECT_FALSE(is_announcement(whole.data(), size)) << size;
}

TEST(RtpsCheck, OnlyStatisticsAreCutOff) {
  const auto plain = [](const Datagram& m) { return size_without_statistics(m.data(), m.size()); };
  EXPECT_EQ(plain(message({submessage(kData, 24), submessage(kStatistics, 56)})), 48u);
  EXPECT_EQ(plain(message({submessage(kData, 24)})), 48u);
  EXPECT_EQ(plain(message({{kData, 1, 0, 0, kStatistics, 1, 0, 0}})), 28u) << "up to the end";
  EXPECT_EQ(plain(message({{kData, 1}})), 22u);
}

TEST(RtpsCheck, TheSenderStandsInTheHeader) {
  Datagram datagram = message({});
  for (std::uint8_t i = 0; i < 12; ++i) datagram[8U + i] = i;
  EXPECT_EQ(sender_of(datagram.data()),
            (std::array<std::uint8_t, 12>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}));
}

}  // namespace
}  // namespace covey
