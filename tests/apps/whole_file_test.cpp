// SPDX-License-Identifier: Apache-2.0
#include "apps/whole_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <stdexcept>
#include <string>

#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

void expect_refused(const fs::path& file, const std::string& why) {
  const auto refused = ThrowsMessage<std::runtime_error>(HasSubstr(file.string() + ": " + why));
  EXPECT_THAT([&] { require_writable(file); }, refused);
  EXPECT_THAT([&] { write_whole_file(file, "new"); }, refused);
}

TEST(WholeFile, WhyItCannotBeReadIsSaid) {
  const TemporaryFolder folder;
  const fs::path file = folder.write("file", "content"), circle = folder.path() / "circle";
  fs::create_symlink("circle", circle);
  EXPECT_EQ(read_whole_file(file), "content");
  const auto expect = [](const fs::path& path, const std::string& why) {
    EXPECT_THAT([&] { (void)read_whole_file(path); },
                ThrowsMessage<std::runtime_error>(path.string() + ": cannot be read: " + why));
  };
  expect(folder.path() / "nowhere", "is the path right?");
  expect(folder.path(), "it is a folder");
  expect(file / "below", "Not a directory");
  expect(circle, "Too many levels of symbolic links");
  expect("/proc/self/mem", "Input/output error");  // it can be opened, its first byte not read
}

TEST(WholeFile, AnEmptyOneAndOneOfManyBlocksAreReadAsTheyAre) {
  const TemporaryFolder folder;
  EXPECT_EQ(read_whole_file(folder.write("empty", "")), "");
  std::string long_one(300'000, 'x');
  long_one.back() = 'y';
  EXPECT_EQ(read_whole_file(folder.write("long", long_one)), long_one);
}

TEST(WholeFile, WhyItCouldNotBeWrittenIsSaidBeforeTheWork) {
  const TemporaryFolder folder;
  const fs::path file = folder.path() / std::string(255, 'x');
  EXPECT_THAT(
      [&] { require_writable(file); },
      ThrowsMessage<std::runtime_error>(HasSubstr("cannot be written: File name too long")));
}

TEST(WholeFile, TakesThePlaceOfAnEarlierOneAndOfNothingElse) {
  const TemporaryFolder folder;
  const fs::path file = folder.write("words.txt", "old");
  const fs::path mine = folder.write("words.txt.part", "mine");
  require_writable(file);
  EXPECT_EQ(file_content(file), "old");
  write_whole_file(file, "new");
  EXPECT_EQ(file_content(file), "new");
  EXPECT_EQ(file_content(mine), "mine");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 2);
}

TEST(WholeFile, LinksStayAndWhatTheyLeadToIsReplaced) {
  const TemporaryFolder folder;
  const fs::path file = folder.write("disk/words.txt", "old"), link = folder.path() / "link";
  fs::create_symlink("disk/words.txt", link);
  write_whole_file(link, "new");
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_EQ(file_content(file), "new");
}

TEST(WholeFile, WhatIsNoFileIsNotReplaced) {
  const TemporaryFolder folder;
  const fs::path pipe = folder.path() / "pipe", link = folder.path() / "link";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  fs::create_symlink("nowhere", link);
  expect_refused(pipe, "is no file that can be replaced");
  expect_refused(link, "is a link to nothing");
  expect_refused(folder.path(), "is a folder");
  EXPECT_TRUE(fs::is_fifo(pipe));
  EXPECT_TRUE(fs::is_symlink(link));
}

}  // namespace
}  // namespace covey
