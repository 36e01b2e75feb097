// SPDX-License-Identifier: Apache-2.0
//
// `covey keys`, and drones that fly with what it makes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "comms/key_folder.h"
#include "comms/peer_link.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class Keys : public testing::Test {
 protected:
  [[nodiscard]] fs::path keys() const { return folder_.path() / "keys"; }

  // Adds `--out`. What the program said; its exit code is checked.
  [[nodiscard]] std::string run(std::vector<std::string> arguments, int exit_code = 0) const {
    arguments.insert(arguments.begin(), "keys");
    arguments.insert(arguments.end(), {"--out", keys().string()});
    CoveyProcess covey(arguments);
    EXPECT_EQ(covey.finish(), exit_code) << covey.output();
    return covey.output();
  }

  [[nodiscard]] std::set<std::string> entries(const fs::path& folder) const {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename());
    return names;
  }

  [[nodiscard]] CoveyProcess fly_with(const std::string& link) const {
    const fs::path config = folder_.write("config.json", "{\"link\": " + link + "}");
    return CoveyProcess({"team", COVEY_TEST_FLIGHT, "--config", config.string(), "--out",
                         (folder_.path() / "run").string(), "--force"});
  }

  void expect_usable(const std::string& drone) const {
    LinkConfig config;
    config.agent = drone;
    config.team = "blue";
    config.security = keys().string();
    EXPECT_NO_THROW(check_keys(config)) << drone;
  }

 private:
  TemporaryFolder folder_;
};

TEST_F(Keys, EachDroneGetsAFolderThatIsAllItNeeds) {
  EXPECT_THAT(run({"--team", "blue", "uav0", "uav1"}), HasSubstr("keys of team blue"));
  EXPECT_THAT(entries(keys()), ElementsAre("team.authority", "uav0", "uav1"));
  fs::remove_all(keys() / "team.authority");
  fs::remove_all(keys() / "uav1");
  expect_usable("uav0");
  EXPECT_EQ(fs::status(keys() / "uav0" / kPrivateKeyFile).permissions(),
            fs::perms::owner_read | fs::perms::owner_write);
}

TEST_F(Keys, DronesJoinAndAreRevoked) {
  (void)run({"--team", "blue", "uav0", "uav1"});
  const std::string before = file_content(keys() / "uav0" / kRevokedFile);
  (void)run({"--add", "uav9"});
  expect_usable("uav9");
  EXPECT_EQ(file_content(keys() / "uav0" / kRevokedFile), before);
  EXPECT_THAT(run({"--revoke", "uav1"}), HasSubstr("Copy revoked.pem"));
  EXPECT_THAT(entries(keys()), ElementsAre("team.authority", "uav0", "uav9"));
  const std::string after = file_content(keys() / "uav0" / kRevokedFile);
  EXPECT_NE(after, before);
  EXPECT_EQ(file_content(keys() / "uav9" / kRevokedFile), after);
  expect_usable("uav0");
  (void)run({"--add", "uav1"});  // with new keys it is another one
  expect_usable("uav1");
}

TEST_F(Keys, NothingIsOverwrittenUnlessItIsSaid) {
  (void)run({"--team", "blue", "uav0"});
  const std::string key = file_content(keys() / "uav0" / kPrivateKeyFile);
  EXPECT_THAT(run({"--team", "blue", "uav0"}, 1),
              AllOf(HasSubstr(keys().string()), HasSubstr("exists already"), HasSubstr("--force")));
  EXPECT_THAT(run({"--add", "uav0"}, 1), HasSubstr("uav0: has keys already"));
  EXPECT_EQ(file_content(keys() / "uav0" / kPrivateKeyFile), key);
  (void)run({"--team", "blue", "uav0", "--force"});
  EXPECT_NE(file_content(keys() / "uav0" / kPrivateKeyFile), key);
}

TEST_F(Keys, AFolderOfOtherThingsIsNotReplaced) {
  fs::create_directories(keys());
  std::ofstream(keys() / "thesis.txt") << "mine";
  EXPECT_THAT(run({"--team", "blue", "uav0", "--force"}, 1), HasSubstr("there is something else"));
  EXPECT_EQ(file_content(keys() / "thesis.txt"), "mine");
}

TEST_F(Keys, NobodysOwnFilesAreReplacedAmongKeys) {
  (void)run({"--team", "blue", "uav0"});
  const std::string key = file_content(keys() / "uav0" / kPrivateKeyFile);
  for (const char* own : {"thesis.txt", "uav0/thesis.txt", "team.authority/thesis.txt",
                          "team.authority/drones/thesis.txt", "thesis/key.txt"}) {
    fs::create_directories((keys() / own).parent_path());
    std::ofstream(keys() / own) << "mine";
    EXPECT_THAT(run({"--team", "blue", "uav0", "--force"}, 1), HasSubstr("there is something else"))
        << own;
    EXPECT_EQ(file_content(keys() / own), "mine");
    fs::remove(keys() / own);
  }
  EXPECT_EQ(file_content(keys() / "uav0" / kPrivateKeyFile), key);
  fs::remove(keys() / "thesis");
  (void)run({"--revoke", "uav0"});
  (void)run({"--team", "blue", "uav1", "--force"});
  EXPECT_THAT(entries(keys()), ElementsAre("team.authority", "uav1"));
}

TEST_F(Keys, WhatCannotBeIsNamedAndLeavesNothing) {
  EXPECT_THAT(run({"--team", "blue", "uav 0"}, 1), HasSubstr("\"uav 0\" is not a name"));
  EXPECT_THAT(run({"--team", "b/lue", "uav0"}, 1), HasSubstr("\"b/lue\" is not a name"));
  EXPECT_THAT(run({"--team", "blue", "uav0", "uav0"}, 1), HasSubstr("uav0 is named twice"));
  EXPECT_THAT(run({"--team", "blue"}, 2), HasSubstr("names of the drones"));
  EXPECT_THAT(run({}, 2), HasSubstr("--team, --add and --revoke"));
  EXPECT_THAT(run({"--team", "blue", "uav0", "--days", "0"}, 2), HasSubstr("--days"));
  EXPECT_THAT(run({"--team", "blue", "uav0", "--add", "uav1"}, 2), HasSubstr("--add"));
  EXPECT_THAT(entries(keys().parent_path()), testing::IsEmpty());
}

TEST_F(Keys, AFolderThatIsNoneOrIsDamagedIsNamed) {
  EXPECT_THAT(run({"--add", "uav1"}, 1),
              AllOf(HasSubstr("team.authority/team.json: cannot be read"), HasSubstr("--team")));
  (void)run({"--team", "blue", "uav0"});
  EXPECT_THAT(run({"--revoke", "uav7"}, 1),
              HasSubstr("no keys of uav7 to revoke (there are: uav0)"));
  std::ofstream(keys() / "team.authority" / "identity_key.pem") << "no key";
  EXPECT_THAT(run({"--add", "uav1"}, 1), HasSubstr("authority is damaged"));
  std::ofstream(keys() / "team.authority" / "team.json") << "{";
  EXPECT_THAT(run({"--add", "uav1"}, 1), HasSubstr("team.json: is damaged"));
  EXPECT_THAT(entries(keys()), ElementsAre("team.authority", "uav0"));
}

TEST_F(Keys, ATeamFliesWithThemAndNotWithoutThem) {
  CoveyProcess without = fly_with(R"({"profile": "secure"})");
  EXPECT_NE(without.finish(), 0);
  EXPECT_THAT(without.output(), HasSubstr("the profile requires keys"));
  (void)run({"--team", "blue", "uav0", "uav1"});
  CoveyProcess with =
      fly_with(R"({"profile": "secure", "team": "blue", "security": ")" + keys().string() + "\"}");
  EXPECT_EQ(with.finish(), 0) << with.output();
}

}  // namespace
}  // namespace covey
