// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <stdexcept>

#include "apps/csv.h"
#include "apps/run_files.h"
#include "tests/apps/full_disk.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

TimingRecord timing_at(TimeNs stamp_ns) {
  TimingRecord record;
  record.stamp_ns = stamp_ns;
  record.tracks = 200;
  return record;
}

TEST(LineWriter, WritesOnOnceAFullDiskHasRoomAgainAndTearsNoLine) {
  const TemporaryFolder folder;
  TimingWriter writer(folder.path());
  std::optional<FullDisk> full(std::in_place, 1000);
  for (TimeNs stamp_ns = 1; stamp_ns <= 20; ++stamp_ns) writer.write(timing_at(stamp_ns));
  full.reset();
  for (TimeNs stamp_ns = 21; stamp_ns <= 25; ++stamp_ns) writer.write(timing_at(stamp_ns));

  const auto timings = read_timings(folder.path() / kTimingsFile);
  const auto lost = static_cast<std::int64_t>(25 - timings.size());
  ASSERT_GT(timings.size(), 5u) << "some before the disk was full, and five after it";
  EXPECT_GT(lost, 0);
  EXPECT_EQ(timings[timings.size() - 6].stamp_ns, 20 - lost);
  EXPECT_EQ(timings[timings.size() - 5].stamp_ns, 21);
  EXPECT_EQ(timings.back().stamp_ns, 25);
  for (const TimingRecord& record : timings) EXPECT_EQ(record.tracks, 200);
  EXPECT_EQ(writer.lost_lines(), LostLines({{kTimingsFile, lost}}));
}

TEST(LineWriter, AHeaderForWhichThereWasNoRoomComesWithTheFirstLine) {
  const TemporaryFolder folder;
  std::optional<FullDisk> full(std::in_place, 8);
  TimingWriter writer(folder.path());
  writer.write(timing_at(1));
  full.reset();
  writer.write(timing_at(2));
  const auto timings = read_timings(folder.path() / kTimingsFile);
  ASSERT_EQ(timings.size(), 1u);
  EXPECT_EQ(timings[0].stamp_ns, 2);
}

TEST(LineWriter, WhoNeedsEveryLineIsToldHowManyAreMissing) {
  const TemporaryFolder folder;
  LineWriter writer(folder.path() / "lines.csv");
  writer.write_line("1");
  EXPECT_NO_THROW(writer.require_whole());
  const FullDisk full(3);
  writer.write_line("2");
  writer.write_line("3");
  EXPECT_THAT([&] { writer.require_whole(); },
              ThrowsMessage<std::runtime_error>(HasSubstr("lines.csv: 2 lines could not be")));
}

}  // namespace
}  // namespace covey
