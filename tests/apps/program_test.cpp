// SPDX-License-Identifier: Apache-2.0
//
// What the program does with the streams and limits that it is started with.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;

// The exit code of a line of the shell; $COVEY is the program, in a folder of its own.
class Program : public ::testing::Test {
 protected:
  [[nodiscard]] int shell(const std::string& line) const {
    const std::string start = "COVEY='" COVEY_PROGRAM "'; cd '" + folder_.path().string() + "' && ";
    const int status = std::system((start + line).c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  [[nodiscard]] std::string content(const char* file) const {
    return file_content(folder_.path() / file);
  }

  TemporaryFolder folder_;
};

constexpr char kSimulate[] =
    "$COVEY simulate castle_parallel --agents 1 --seconds 1 --rate 5 --out ";

TEST_F(Program, SaysNothingIntoItsFilesWhereStreamsAreClosed) {
  const std::string simulate = kSimulate;
  ASSERT_EQ(shell(simulate + "open 2> /dev/null > /dev/null"), 0);
  ASSERT_EQ(shell(simulate + "closed <&- >&- 2>&-"), 0);
  EXPECT_EQ(shell("diff -r open closed"), 0);
}

TEST_F(Program, AFileThatMayNotGrowIsNamedAndNothingIsLeft) {
  const std::string simulate = kSimulate;
  EXPECT_EQ(shell("(ulimit -f 16; " + simulate + "out 2> said)"), 1);
  EXPECT_THAT(content("said"), HasSubstr("cannot be written"));
  EXPECT_EQ(shell("test \"$(ls)\" = said"), 0);
}

TEST_F(Program, WhatCannotBePrintedIsAFailure) {
  for (const char* const command :
       {"agent --print-config", "qos --profile clean --xml", "--help"}) {
    EXPECT_EQ(shell(std::string("$COVEY ") + command + " > /dev/full 2> said"), 1) << command;
    EXPECT_EQ(content("said"), "covey: standard output: cannot be written: is the disk full?\n");
  }
}

TEST_F(Program, AReaderWhoHasReadEnoughIsNoFailure) {
  // With SIGPIPE ignored, as Python hands it on; started when the reader has left.
  EXPECT_EQ(shell("trap '' PIPE; mkfifo gone; "
                  "(read now < gone; $COVEY agent --print-config; echo $? > code) 2> said "
                  "| (exec <&-; echo now > gone)"),
            0);
  EXPECT_EQ(content("code") + content("said"), "0\n");
}

TEST_F(Program, TellsItsVersion) {
  EXPECT_EQ(shell("$COVEY --version > said"), 0);
  EXPECT_THAT(content("said"), MatchesRegex("covey [0-9]+\\.[0-9]+\\.[0-9]+\n"));
}

TEST_F(Program, NamesTheWordThatItDoesNotKnow) {
  EXPECT_EQ(shell("$COVEY --bogus 2> said"), 2);
  EXPECT_EQ(content("said"), "covey: no option '--bogus' (see covey --help)\n");
  EXPECT_EQ(shell("$COVEY bogus 2> said"), 2);
  EXPECT_EQ(content("said"), "covey: no command 'bogus' (see covey --help)\n");
}

}  // namespace
}  // namespace covey
