// SPDX-License-Identifier: Apache-2.0
#include "apps/link_record.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "apps/file_descriptor.h"
#include "apps/record_channel.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

template <typename T>
std::string reason(const Decoded<T>& decoded) {
  const auto* rejected = std::get_if<Rejected>(&decoded);
  return rejected == nullptr ? "" : rejected->reason;
}

Bytes stream_of(const std::vector<Record>& records) {
  RecordWriter writer;
  for (const Record& record : records) EXPECT_TRUE(writer.offer(record.kind, record.content));
  return {writer.data(), writer.data() + writer.size()};
}

// Given in pieces of `size` bytes.
std::vector<Record> read_in_pieces(const Bytes& stream, std::size_t size) {
  RecordReader reader;
  std::vector<Record> records;
  for (std::size_t at = 0; at < stream.size(); at += size) {
    reader.append(stream.data() + at, std::min(size, stream.size() - at));
    while (const auto record = reader.next()) records.push_back(std::get<Record>(*record));
  }
  return records;
}

// What the reader says to these first bytes.
std::string complaint(const Bytes& start) {
  RecordReader reader;
  reader.append(start.data(), start.size());
  const auto next = reader.next();
  return next ? reason(*next) : "incomplete";
}

LinkReport report() {
  LinkReport out;
  out.statistics.message = {1, 2, 3, 4, 5};
  out.statistics.messages_sent_to = {{"uav1", 7}};
  out.statistics.rejected = {{"uav1", {{"sample too short", 8}}}};
  out.statistics.unseen_port = 7412;
  out.statistics.missing_network = "link.interfaces has no carrier";
  out.statistics.last_dds_error = "odd bytes: \xff\xfe";
  out.statistics.clocks = {{"uav1", {-3'000'000'001, 2'000'000}}};
  out.statistics.wire_bytes_sent = 0xffffffffffffffffULL;
  out.peers = {"uav1", "uav2"};
  return out;
}

TEST(LinkRecord, RecordsComeOutOfAStreamHoweverItIsCut) {
  const std::vector<Record> records = {{RecordKind::kSettings, to_bytes("{}")},
                                       {RecordKind::kStatus, {}},
                                       {RecordKind::kMessage, encode(samples::keyframe())}};
  const Bytes stream = stream_of(records);
  for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, stream.size()}) {
    const std::vector<Record> read = read_in_pieces(stream, piece);
    ASSERT_EQ(read.size(), records.size()) << piece;
    for (std::size_t i = 0; i < records.size(); ++i) {
      EXPECT_EQ(read[i].kind, records[i].kind);
      EXPECT_EQ(read[i].content, records[i].content);
    }
  }
}

TEST(LinkRecord, ATruncatedRecordIsWaitedFor) {
  const Bytes stream = stream_of({{RecordKind::kComplaint, to_bytes("why")}});
  for (std::size_t size = 0; size < stream.size(); ++size)
    EXPECT_EQ(complaint(Bytes(stream.begin(), stream.begin() + static_cast<long>(size))),
              "incomplete");
}

TEST(LinkRecord, AnythingElseIsRefusedAtItsHeader) {
  EXPECT_EQ(complaint(to_bytes("hello, world")), "no record");
  EXPECT_EQ(complaint({'c', 'v', kRecordVersion + 1, 0, 0, 0, 0, 0}), "record of another version");
  EXPECT_EQ(complaint({'c', 'v', kRecordVersion, 8, 0, 0, 0, 0}), "unknown kind of record");
  EXPECT_EQ(complaint({'c', 'v', kRecordVersion, 4, 0xff, 0xff, 0xff, 0xff}), "record too long");
  EXPECT_EQ(complaint({'c', 'v', kRecordVersion, 4, 0x00, 0x36, 0, 0}), "incomplete");  // 13824
  EXPECT_EQ(complaint({'c', 'v', kRecordVersion, 4, 0x01, 0x36, 0, 0}), "record too long");
}

TEST(LinkRecord, WhatWaitsIsBounded) {
  RecordWriter writer;
  const Bytes large(max_content(RecordKind::kFullMessage));
  int taken = 0;
  while (writer.offer(RecordKind::kFullMessage, large)) ++taken;
  EXPECT_GE(taken, 1);
  EXPECT_LT(writer.size(), 5 * large.size());
  EXPECT_FALSE(RecordWriter().offer(RecordKind::kStatus, large));  // longer than any status
  writer.drop(writer.size());
  EXPECT_TRUE(writer.offer(RecordKind::kFullMessage, large));
}

TEST(LinkRecord, AReportSurvivesWhateverDdsSaid) {
  const auto decoded = decode_link_report(encode(report()));
  ASSERT_EQ(reason(decoded), "");
  const LinkReport& got = std::get<LinkReport>(decoded);
  EXPECT_EQ(got.peers, report().peers);
  EXPECT_EQ(got.statistics.message.payload_bytes_received, 5U);
  EXPECT_EQ(got.statistics.messages_sent_to, report().statistics.messages_sent_to);
  EXPECT_EQ(got.statistics.rejected, report().statistics.rejected);
  EXPECT_EQ(got.statistics.clocks.at("uav1").offset_ns, -3'000'000'001);
  EXPECT_EQ(got.statistics.clocks.at("uav1").round_trip_ns, 2'000'000);
  EXPECT_EQ(got.statistics.wire_bytes_sent, 0xffffffffffffffffULL);
  EXPECT_EQ(got.statistics.unseen_port, 7412U);
  EXPECT_EQ(got.statistics.missing_network, "link.interfaces has no carrier");
  EXPECT_EQ(got.statistics.last_dds_error.rfind("odd bytes: ", 0), 0U);
}

TEST(LinkRecord, AReportThatNobodyCanMeanIsRefused) {
  const std::string good = to_text(encode(report()));
  const auto after = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return reason(decode_link_report(to_bytes(text.replace(at, from.size(), to))));
  };
  EXPECT_EQ(reason(decode_link_report({})), "report is not JSON");
  EXPECT_EQ(reason(decode_link_report(to_bytes(good.substr(1)))), "report is not JSON");
  EXPECT_EQ(reason(decode_link_report(to_bytes("{}"))), "report of another form");
  EXPECT_EQ(after("\"peers\"", "\"pears\""), "report of another form");
  EXPECT_EQ(after("\"uav2\"", "\"../uav2\""), "report of a peer that is not a drone's name");
  for (const char* number : {"-1", "1e300", "0.5", "null", "true"})
    EXPECT_EQ(after("18446744073709551615", number), "report holds something else than counts");
  EXPECT_EQ(after("18446744073709551615", "\"many\""), "report of another form");
  for (const char* number :
       {"-9223372036854775808", "18446744073709551615", "1e300", "0.5", "null"})
    EXPECT_EQ(after("-3000000001", number), "report of clocks that are none") << number;
  EXPECT_EQ(after("2000000", "-1"), "report of clocks that are none");
  EXPECT_EQ(after("\"uav1\":{\"offset", "\"u v1\":{\"offset"), "report of clocks that are none");
  EXPECT_EQ(after("\"clocks\"", "\"docks\""), "report holds something else than counts");
}

// As deep as a record is long: who calls itself for each level has no stack for that.
TEST(LinkRecord, AReportThatIsNestedDeepIsRefused) {
  const std::size_t levels = max_content(RecordKind::kReport) / 2 - 16;
  const std::string deep = std::string(levels, '[') + std::string(levels, ']');
  for (const std::string& text :
       {deep, "{\"statistics\":" + deep + "}", "{\"clocks\":" + deep + "}",
        "{\"clocks\":" + std::string(levels, '[')})
    EXPECT_EQ(reason(decode_link_report(to_bytes(text))), "report is nested too deep");
}

TEST(LinkRecord, RandomDamageDoesNoHarm) {
  const Bytes stream = stream_of(
      {{RecordKind::kReport, encode(report())}, {RecordKind::kRequest, encode(samples::advert())}});
  std::mt19937 random(7);
  for (int round = 0; round < 4000; ++round) {
    Bytes bytes = stream;
    for (int hits = 1 + static_cast<int>(random() % 8); hits > 0; --hits)
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    RecordReader reader;
    reader.append(bytes.data(), random() % bytes.size());
    while (const auto next = reader.next()) {
      const auto* record = std::get_if<Record>(&*next);
      if (record == nullptr) break;
      (void)decode_link_report(record->content);
    }
  }
}

TEST(LinkStatistics, LivesAddUp) {
  const LinkStatistics one = report().statistics;
  LinkStatistics other = one;
  other.process_peak_kib = 5;
  other.clocks["uav1"].offset_ns = 4;
  const LinkStatistics both = sum(one, other);
  EXPECT_EQ(both.message.received, 4U);
  EXPECT_EQ(both.messages_sent_to.at("uav1"), 14U);
  EXPECT_EQ(both.rejected.at("uav1").at("sample too short"), 16U);
  EXPECT_EQ(both.process_peak_kib, 5U);
  EXPECT_EQ(both.clocks.at("uav1").offset_ns, 4);
}

TEST(LinkStatistics, NamesThatNeverEndAreCountedTogether) {
  LinkStatistics all;
  for (int life = 0; life < 50; ++life) {
    LinkStatistics now;
    for (int i = 0; i < 20; ++i)
      now.refused["reason " + std::to_string(life) + " " + std::to_string(i)] = 1;
    all = sum(std::move(all), now);
  }
  EXPECT_LT(all.refused.size(), 400U);
  EXPECT_GT(all.refused.at("others"), 600U);
}

TEST(RecordChannel, ARecordLargerThanTheSocketArrivesAndNobodyWaits) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
  const FileDescriptor here(ends[0]), there(ends[1]);
  RecordChannel sender(here.get()), receiver(there.get());
  const Bytes large(max_content(RecordKind::kFullMessage), 1);
  EXPECT_TRUE(sender.offer(RecordKind::kFullMessage, large));
  std::optional<Decoded<Record>> got;
  while (!got) {
    ASSERT_TRUE(sender.exchange(std::chrono::milliseconds(0)));
    ASSERT_TRUE(receiver.exchange(std::chrono::milliseconds(0)));
    got = receiver.next();
  }
  EXPECT_EQ(std::get<Record>(*got).content, large);
}

TEST(RecordChannel, WhatWasSaidLastIsStillThereWhenTheOtherHasGone) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
  const FileDescriptor here(ends[0]);
  RecordChannel receiver(here.get());
  {
    const FileDescriptor there(ends[1]);
    RecordChannel sender(there.get());
    EXPECT_TRUE(sender.offer(RecordKind::kComplaint, to_bytes("no such interface")));
    EXPECT_TRUE(sender.finish(std::chrono::seconds(10)));
  }
  EXPECT_TRUE(receiver.offer(RecordKind::kStatus, {}));  // to nobody
  while (receiver.exchange(std::chrono::seconds(10))) {
  }
  const auto last = receiver.next();
  ASSERT_TRUE(last);
  EXPECT_EQ(to_text(std::get<Record>(*last).content), "no such interface");
}

}  // namespace
}  // namespace covey
