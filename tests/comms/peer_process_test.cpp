// SPDX-License-Identifier: Apache-2.0
//
// Links in processes of their own, as they fly.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>

#include <csignal>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "comms/peer_link.h"
#include "tests/comms/samples.h"
#include "tests/comms/team_config.h"

extern char** environ;

namespace covey {
namespace {

// One covey_comms_peer; killed if it still runs when it goes out of scope.
class PeerProcess {
 public:
  PeerProcess(const LinkConfig& team, int rounds, std::vector<std::string> self_and_peers) {
    std::vector<std::string> words = {COVEY_COMMS_PEER, team.team, std::to_string(team.domain),
                                      std::to_string(rounds)};
    words.insert(words.end(), self_and_peers.begin(), self_and_peers.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    if (posix_spawn(&pid_, argv[0], nullptr, nullptr, argv.data(), environ) != 0) pid_ = -1;
  }
  ~PeerProcess() {
    if (pid_ > 0) kill_and_wait();
  }
  PeerProcess(const PeerProcess&) = delete;
  PeerProcess& operator=(const PeerProcess&) = delete;

  [[nodiscard]] int exit_code() {
    int status = 0;
    if (pid_ < 0 || waitpid(pid_, &status, 0) != pid_) return -1;
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -2;
  }
  void kill_and_wait() {
    kill(pid_, SIGKILL);
    (void)exit_code();
  }

 private:
  pid_t pid_ = -1;
};

TEST(PeerProcesses, ThreeInLockstepLoseNothing) {
  const LinkConfig team = team_config("uav0");
  PeerProcess a(team, 100, {"uav0", "uav1", "uav2"});
  PeerProcess b(team, 100, {"uav1", "uav0", "uav2"});
  PeerProcess c(team, 100, {"uav2", "uav0", "uav1"});
  EXPECT_EQ(a.exit_code(), 0);
  EXPECT_EQ(b.exit_code(), 0);
  EXPECT_EQ(c.exit_code(), 0);
}

TEST(PeerProcesses, AKilledPeerIsMissedAndItsSuccessorIsServed) {
  PeerLink link(team_config("uav0"));
  PeerProcess first(team_config("uav0"), 0, {"uav1", "uav0"});
  ASSERT_TRUE(link.wait_for_peers({"uav1"}, kPatience));
  first.kill_and_wait();

  // Nothing tells us but silence: liveliness ends after 1.9 s, and 2 s is the promise.
  const auto start = std::chrono::steady_clock::now();
  while (!link.peers().empty() && std::chrono::steady_clock::now() - start < kPatience)
    std::this_thread::yield();
  EXPECT_TRUE(link.peers().empty());
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(2));

  // Within the 9 s in which the dead participant is still remembered.
  PeerProcess second(team_config("uav0"), 0, {"uav1", "uav0"});
  ASSERT_TRUE(link.wait_for_peers({"uav1"}, kPatience));
  EXPECT_TRUE(link.send(samples::keyframe("uav0", "uav1")));
}

}  // namespace
}  // namespace covey
