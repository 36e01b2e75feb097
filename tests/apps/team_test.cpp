// SPDX-License-Identifier: Apache-2.0
//
// Whole teams of processes on a small simulated flight.
#include "apps/team.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "apps/control_channel.h"
#include "apps/free_domain.h"
#include "apps/run_folder.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/eventually.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

constexpr char kDataset[] = COVEY_TEST_FLIGHT;  // two drones, made by the fixture

class Team : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string("covey_team_") + test->name();
    std::replace(name.begin(), name.end(), '/', '_');  // of a parameter
    run_ = fs::path(testing::TempDir()) / name;
    fs::remove_all(run_);
  }
  void TearDown() override { fs::remove_all(run_); }

  [[nodiscard]] std::vector<std::string> command(const std::vector<std::string>& more) const {
    std::vector<std::string> arguments{"team", kDataset, "--out", run_.string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  [[nodiscard]] json summary() const { return json::parse(file_content(run_ / "summary.json")); }

  [[nodiscard]] std::string trajectories() const {
    return file_content(run_ / "uav0" / "trajectory.tum") +
           file_content(run_ / "uav1" / "trajectory.tum");
  }

  // To one drone's agent. False if it does not run.
  [[nodiscard]] bool signal_agent(const std::string& drone, int signal_number) const {
    const auto pid = find_process((run_ / drone / "config.json").string());
    return pid && kill(*pid, signal_number) == 0;
  }

  fs::path run_;
};

// Keeps all cores busy while it lives.
class Load {
 public:
  Load() {
    for (unsigned i = 0; i < 2 * std::thread::hardware_concurrency(); ++i) {
      threads_.emplace_back([this] {
        while (!stop_.load()) {
        }
      });
    }
  }
  ~Load() {
    stop_ = true;
    for (std::thread& thread : threads_) thread.join();
  }

 private:
  std::atomic<bool> stop_{false};
  std::vector<std::thread> threads_;
};

// Both processes read this machine's clock, which is what they have to find.
void expect_same_clock(const json& clocks, const std::string& peer) {
  ASSERT_TRUE(clocks.contains(peer)) << clocks;
  const double offset_ms = clocks[peer]["clock_offset_ms"];
  EXPECT_LE(std::abs(offset_ms), clocks[peer]["round_trip_ms"].get<double>() / 2 + 1e-6);
}

TEST_F(Team, FliesTogetherAndLeavesEverythingARunHas) {
  CoveyProcess covey(command({"--init", "groundtruth", "--with-solo"}));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  for (const char* drone : {"uav0", "uav1"}) {
    for (const char* file : {"trajectory.tum", "trajectory_covariance.csv", "timings.csv",
                             "link.csv", "groundtruth.tum"}) {
      EXPECT_TRUE(fs::exists(run_ / drone / file)) << drone << " " << file;
      if (std::string(file) != "link.csv") {
        EXPECT_TRUE(fs::exists(run_ / "solo" / drone / file)) << drone << " " << file;
      }
    }
    const json agent = summary()["agents"][drone];
    EXPECT_EQ(agent["frames"], COVEY_TEST_FLIGHT_FRAMES);
    EXPECT_EQ(agent["frames_dropped"], 0);
    EXPECT_LT(agent["ate_m"]["none"]["rmse"], 0.5);  // m; the flight is a few metres long
    EXPECT_GT(agent["link"]["request"]["sent"], 0);
    EXPECT_GT(agent["link"]["request"]["received"], 0);
    EXPECT_FALSE(agent.contains("incomplete"));
    expect_same_clock(agent["link"]["clocks"], std::string(drone) == "uav0" ? "uav1" : "uav0");
  }
  EXPECT_TRUE(fs::exists(run_ / "report.html"));
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("uav0"), HasSubstr("uav1"), HasSubstr("alone")));
}

class TeamExchange : public Team, public testing::WithParamInterface<const char*> {};

TEST_P(TeamExchange, LockstepGivesTheSameBytesWhateverTheMachinesLoad) {
  CoveyProcess quiet(command({"--exchange", GetParam()}));
  ASSERT_EQ(quiet.finish(), 0) << quiet.output();
  const std::string first = trajectories();
  ASSERT_GT(first.size(), 1000U);
  EXPECT_EQ(summary()["exchange"], GetParam());

  const Load load;
  CoveyProcess busy(command({"--exchange", GetParam(), "--force"}));
  ASSERT_EQ(busy.finish(), 0) << busy.output();
  EXPECT_TRUE(trajectories() == first);
}

INSTANTIATE_TEST_SUITE_P(AllExchanges, TeamExchange, testing::Values("compact", "paper", "naive"),
                         [](const auto& exchange) { return std::string(exchange.param); });

TEST_F(Team, TheExchangesCostWhatTheySay) {
  std::map<std::string, json> link;
  for (const std::string exchange : {"compact", "paper", "naive"}) {
    CoveyProcess covey(command({"--exchange", exchange, "--force"}));
    ASSERT_EQ(covey.finish(), 0) << covey.output();
    link[exchange] = summary()["agents"]["uav0"]["link"];
  }
  const auto bytes = [&](const std::string& exchange) {
    return link[exchange]["request"]["payload_bytes_sent"].get<double>() +
           link[exchange]["message"]["payload_bytes_sent"].get<double>();
  };
  // A question per image, of 2.05 kB in the paper; 2 kB of VLAD and what is around it here.
  const json& questions = link["paper"]["request"];
  const double question_bytes =
      questions["payload_bytes_sent"].get<double>() / questions["sent"].get<double>();
  EXPECT_GT(questions["sent"], 2 * link["compact"]["request"]["sent"].get<int>());
  EXPECT_GT(question_bytes, 2048);
  EXPECT_LT(question_bytes, 2300);
  EXPECT_GT(bytes("paper"), 20 * bytes("compact"));
  EXPECT_EQ(link["naive"]["request"]["sent"], 0);
  EXPECT_GT(link["naive"]["message"]["sent"], 20);
  EXPECT_GT(link["naive"]["message"]["received"], 20);
  EXPECT_GT(bytes("naive"), 100 * bytes("compact"));
}

TEST_F(Team, OneThatIsKilledIsNamedAndTheOthersFinish) {
  CoveyProcess covey(command({}));
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  ASSERT_TRUE(signal_agent("uav0", SIGSTOP));  // in lockstep the flight waits for it
  ASSERT_TRUE(signal_agent("uav1", SIGKILL));
  ASSERT_TRUE(signal_agent("uav0", SIGCONT));
  EXPECT_EQ(covey.finish(), 1) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr("covey: uav1 killed by signal 9 (SIGKILL)"));
  const json agents = summary()["agents"];
  EXPECT_EQ(agents["uav0"]["frames"], COVEY_TEST_FLIGHT_FRAMES);
  EXPECT_FALSE(agents["uav0"].contains("incomplete"));
  EXPECT_EQ(agents["uav1"]["incomplete"], "killed by signal 9 (SIGKILL)");
}

TEST_F(Team, CtrlCStopsAllAndKeepsWhatWasFlown) {
  CoveyProcess covey(command({"--pace", "0.2"}));
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  covey.send(SIGINT);
  EXPECT_EQ(covey.finish(), 1) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr("covey: interrupted"));
  EXPECT_EQ(summary()["agents"]["uav0"]["incomplete"], "interrupted");
  EXPECT_FALSE(find_process((run_ / "uav0" / "config.json").string()));
}

TEST_F(Team, NoDroneFliesOnWhenTheTeamWasKilled) {
  CoveyProcess covey(command({"--pace", "0.2"}));
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  covey.send(SIGKILL);
  EXPECT_EQ(covey.finish(), -SIGKILL);  // once nobody can write to its output any more
  for (const char* drone : {"uav0", "uav1"}) {
    const json agent = json::parse(file_content(run_ / drone / "agent_summary.json"));
    EXPECT_LT(agent["frames"], COVEY_TEST_FLIGHT_FRAMES);
    EXPECT_EQ(agent["incomplete"], "was stopped");
  }
}

TEST_F(Team, CtrlCAtTheStartEndsAtOnceAndLeavesNothing) {
  CoveyProcess covey(command({"--unknown-start"}));
  const std::string drone = run_ / "uav0" / "config.json";
  ASSERT_TRUE(eventually([&] { return find_process(drone).has_value(); })) << covey.output();
  covey.send(SIGINT);
  EXPECT_EQ(covey.finish(), 1) << covey.output();
  EXPECT_EQ(covey.output(), "covey: interrupted before the drones flew\n");
  EXPECT_FALSE(fs::exists(run_));
}

TEST_F(Team, WhoIsInterruptedIsNotAskedWhereOtherWorldsLie) {
  CoveyProcess covey(command({"--pace", "0.2", "--unknown-start"}));
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  covey.send(SIGINT);
  EXPECT_EQ(covey.finish(), 1) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr("covey: interrupted; what was flown until then is in"));
  EXPECT_EQ(summary()["agents"]["uav1"]["incomplete"], "interrupted");
}

TEST_F(Team, ByTheClockItIsAsFastAsAskedFor) {
  CoveyProcess covey(command({"--pace", "1", "--mode", "solo", "--agents", "uav0"}));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  const json agent = summary()["agents"]["uav0"];
  EXPECT_EQ(agent["frames"].get<int>() + agent["frames_dropped"].get<int>(),
            COVEY_TEST_FLIGHT_FRAMES);
  EXPECT_LT(summary()["real_time_factor"], 1.05);
  EXPECT_TRUE(agent["link"].is_null());
  EXPECT_FALSE(summary()["agents"].contains("uav1"));
}

TEST_F(Team, AnUnknownKeyOfTheConfigurationIsNamedBeforeAnythingStarts) {
  const std::string file = testing::TempDir() + "covey_team_unknown_key.json";
  std::ofstream(file) << R"({"estimator": {"max_clone": 3}})";
  CoveyProcess covey(command({"--config", file}));
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(),
              AllOf(HasSubstr("covey: "), HasSubstr("estimator.max_clone"), HasSubstr(file)));
  EXPECT_FALSE(fs::exists(run_));
}

TEST_F(Team, SettingsThatAreNoneAreNamedWhateverIsSaidBesideThem) {
  const TemporaryFolder folder;
  for (const char* const settings : {"[]", R"({"thermal": "raw"})"}) {
    const fs::path file = folder.write("settings.json", settings);
    CoveyProcess covey(command({"--config", file.string(), "--thermal", "raw"}));
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(), StartsWith("covey: " + file.string() + ": "));
  }
}

TEST_F(Team, AFolderWhoseNameIsNotUtf8IsNamed) {
  const TemporaryFolder folder;
  const fs::path dataset = folder.path() / "d\xe9";
  fs::create_directory_symlink(kDataset, dataset);
  for (const char* const mode : {"collaborative", "solo"}) {
    CoveyProcess covey({"team", dataset, "--out", run_, "--mode", mode});
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(), HasSubstr("covey: agent.dataset is not UTF-8"));
    EXPECT_FALSE(fs::exists(run_));
  }
}

TEST_F(Team, AFilterTooLargeForWholeMessagesIsNamedBeforeItFlies) {
  const std::string file = testing::TempDir() + "covey_team_large_filter.json";
  std::ofstream(file) << R"({"estimator": {"max_slam_features": 80}})";
  CoveyProcess covey(command({"--config", file, "--exchange", "naive"}));
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("lower estimator.max_clones or"));
}

TEST_F(Team, ARunThatIsThereIsNotOverwritten) {
  fs::create_directories(run_);
  std::ofstream(run_ / "notes.txt") << "mine";
  CoveyProcess covey(command({}));
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("is not empty"), HasSubstr("--force")));
}

TEST_F(Team, AFolderThatCannotBeIsNamed) {
  const TemporaryFolder folder;
  const fs::path file = folder.write("file", "mine");
  CoveyProcess covey({"team", kDataset, "--out", (file / "sub").string()});
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), StartsWith("covey: " + (file / "sub").string() + ": cannot be made"));
}

TEST_F(Team, MoreDronesThanALinkHoldsAreNamedBeforeAnythingIsTakenAway) {
  TeamOptions options;
  options.out = run_;
  for (int i = 0; i <= kMaxAgents; ++i)
    options.drones.push_back({"uav" + std::to_string(i), "data/mav0"});
  EXPECT_THAT([&] { (void)agent_config(options, options.drones.front(), 0); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("at most 32 drones, not 33")));
  options.mode = FlightMode::kSolo;
  EXPECT_EQ(agent_config(options, options.drones.front(), 0).link.max_agents, kMaxAgents);
  options.drones.resize(4);
  EXPECT_EQ(agent_config(options, options.drones.front(), 0).link.team_size, 4);
}

TEST_F(Team, ThePageOfAThermalFlightHasPicturesAndThatOfAVisualOneHasNot) {
  const TemporaryFolder folder;
  const std::string yard = (folder.path() / "yard").string();
  CoveyProcess simulate(
      {"simulate", "mars_yard", "--agents", "1", "--seconds", "1", "--rate", "8", "--out", yard});
  ASSERT_EQ(simulate.finish(), 0) << simulate.output();
  CoveyProcess thermal({"team", yard, "--mode", "solo", "--out", run_.string()});
  ASSERT_EQ(thermal.finish(), 0) << thermal.output();
  const std::string page = file_content(run_ / "report.html");
  EXPECT_THAT(page, AllOf(HasSubstr("src=\"data:image/png;base64,iVBOR"),
                          HasSubstr(">corner response</text>")));
  CoveyProcess visual(command({"--mode", "solo", "--agents", "uav0", "--force"}));
  ASSERT_EQ(visual.finish(), 0) << visual.output();
  EXPECT_THAT(file_content(run_ / "report.html"),
              AllOf(Not(HasSubstr("<img")), Not(HasSubstr("corner response"))));
}

TEST_F(Team, ForceTakesAwayAllThatAnEarlierRunHasLeft) {
  fs::create_directories(run_ / "uav1");
  for (const char* file :
       {"config.json", "agent_summary.json", "status.json", "trajectory.tum",
        "trajectory_covariance.csv", "groundtruth.tum", "timings.csv", "link.csv", "exchange.csv",
        "thermal.csv", "thermal_field.csv", "thermal_pictures.png", "thermal_corners.csv"}) {
    std::ofstream(run_ / "uav1" / file) << "old";
  }
  CoveyProcess covey(command({"--mode", "solo", "--agents", "uav0", "--force"}));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_FALSE(fs::exists(run_ / "uav1"));
}

TEST_F(Team, AStartThatFailsLeavesAnEarlierRunAsItWas) {
  for (const char* file : {"summary.json", "report.html", "uav0/config.json", "uav0/trajectory.tum",
                           "solo/uav0/config.json", "solo/uav0/timings.csv", "notes.txt"}) {
    fs::create_directories((run_ / file).parent_path());
    std::ofstream(run_ / file) << "old " << file;
  }
  const TemporaryFolder settings;
  const auto config = settings.write("words.json", R"({"agent": {"vocabulary": "/no/words.txt"}})");
  CoveyProcess covey(command({"--force", "--config", config.string()}));
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("could not start: "), HasSubstr("/no/words.txt")));
  std::set<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(run_)) {
    if (entry.is_directory()) continue;
    const std::string file = entry.path().lexically_relative(run_).string();
    files.insert(file);
    EXPECT_EQ(file_content(entry.path()), "old " + file);
  }
  EXPECT_EQ(files.size(), 7U);
}

TEST_F(Team, AFolderThatCannotBeMadeIsNamedInOneLine) {
  fs::create_directories(run_);
  std::ofstream(run_ / "uav0") << "mine";
  CoveyProcess covey(command({"--mode", "solo", "--force"}));
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_EQ(covey.output(), "covey: " + (run_ / "uav0").string() + ": Not a directory\n");
  EXPECT_EQ(file_content(run_ / "uav0"), "mine");
}

TEST_F(Team, TwoDoNotFlyIntoOneFolder) {
  const RunFolder first(run_, true);
  CoveyProcess second(command({"--mode", "solo", "--force"}));
  EXPECT_EQ(second.finish(), 1);
  EXPECT_THAT(second.output(), HasSubstr(run_.string() + ": another covey flies into it"));
}

TEST_F(Team, WhatAStartThatWasKilledHasSetAsideComesBackFirst) {
  fs::create_directories(run_ / ".earlier" / "uav0");
  std::ofstream(run_ / ".earlier" / "uav0" / "config.json") << "old";
  { const RunFolder folder(run_, true); }
  EXPECT_EQ(file_content(run_ / "uav0" / "config.json"), "old");
  EXPECT_FALSE(fs::exists(run_ / ".earlier"));
  {
    RunFolder folder(run_, true);
    folder.keep();
  }
  EXPECT_TRUE(fs::is_empty(run_));
}

TEST_F(Team, DronesOfWhichNobodyKnowsWhereTheyStartAreNamed) {
  const TemporaryFolder dataset;
  for (const char* drone : {"uav0", "uav1"}) {
    const fs::path recorded = fs::path(kDataset) / drone / "mav0";
    const fs::path mav0 = dataset.path() / drone / "mav0";
    fs::create_directories(mav0);
    for (const char* sensor : {"cam0", "imu0"}) {
      fs::create_directory_symlink(recorded / sensor, mav0 / sensor);
    }
  }
  CoveyProcess covey({"team", dataset.path().string(), "--out", run_.string()});
  EXPECT_TRUE(covey.wait_for("uav0, uav1: no ground truth")) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr("fly with --unknown-start"));
  covey.send(SIGINT);
  covey.finish();
}

TEST_F(Team, ABrokenDatasetStopsTheStartAndNamesDroneAndFile) {
  const fs::path broken = run_.string() + "_dataset";
  fs::remove_all(broken);
  fs::create_directories(broken);
  fs::copy(kDataset, broken, fs::copy_options::recursive);
  std::ofstream(broken / "uav1" / "mav0" / "imu0" / "data.csv", std::ios::app) << "12,nonsense\n";
  for (const char* mode : {"collaborative", "solo"}) {
    CoveyProcess covey({"team", broken.string(), "--mode", mode, "--out", run_.string()});
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(),
                AllOf(StartsWith("covey: uav1 could not start: "), HasSubstr("imu0/data.csv:")));
    EXPECT_EQ(std::count(covey.output().begin(), covey.output().end(), '\n'), 1);
    EXPECT_FALSE(fs::exists(run_)) << "so the same command can be given again";
  }
  fs::remove_all(broken);
}

TEST_F(Team, WhereNoDroneStartsThatIsAnErrorAndSaysWhy) {
  const TemporaryFolder dataset;
  fs::copy(kDataset, dataset.path(), fs::copy_options::recursive);
  for (const char* drone : {"uav0", "uav1"}) {
    const fs::path mav0 = dataset.path() / drone / "mav0";
    const std::string images = file_content(mav0 / "cam0" / "data.csv");
    const long long first_image_ns = std::stoll(images.substr(images.find('\n') + 1));
    const fs::path file = mav0 / "state_groundtruth_estimate0" / "data.csv";
    const std::string truth = file_content(file);
    const std::size_t begins = truth.find('\n') + 1;
    const std::size_t pose_begins = truth.find(',', begins);
    const std::string pose = truth.substr(pose_begins, truth.find('\n', begins) + 1 - pose_begins);
    // Between two images.
    std::ofstream(file, std::ios::binary)
        << truth.substr(0, begins) << first_image_ns + 1 << pose << first_image_ns + 2 << pose;
  }
  CoveyProcess covey({"team", dataset.path().string(), "--out", run_.string()});
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(),
              AllOf(HasSubstr("uav1 left no trajectory: the ground truth does not cover"),
                    HasSubstr("covey: no drone has started: the ground truth does not cover")));
}

// So many seconds later.
void shift_stamps(const fs::path& csv, long long by_s) {
  std::istringstream lines(file_content(csv));
  std::string shifted, line;
  while (std::getline(lines, line)) {
    const std::size_t comma = line.find(',');
    if (line.front() != '#')
      line = std::to_string(std::stoll(line) + by_s * 1'000'000'000) + line.substr(comma);
    shifted += line + "\n";
  }
  std::ofstream(csv, std::ios::binary) << shifted;
}

TEST_F(Team, RecordingsThatHaveNoTimeInCommonAreTold) {
  const TemporaryFolder dataset;
  fs::copy(kDataset, dataset.path(), fs::copy_options::recursive);
  const fs::path mav0 = dataset.path() / "uav1" / "mav0";
  for (const char* sensor : {"cam0", "imu0", "state_groundtruth_estimate0"})
    shift_stamps(mav0 / sensor / "data.csv", 100);
  CoveyProcess covey({"team", dataset.path(), "--mode", "solo", "--out", run_});
  EXPECT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr("uav1: its recording begins 97 s after those before it"));
}

TEST_F(Team, ClocksThatAreYearsApartHoldUpNoLockstep) {
  const TemporaryFolder dataset;
  fs::copy(kDataset, dataset.path(), fs::copy_options::recursive);
  for (const char* sensor : {"cam0", "imu0", "state_groundtruth_estimate0"})
    shift_stamps(dataset.path() / "uav1" / "mav0" / sensor / "data.csv", 1'700'000'000);
  CoveyProcess covey({"team", dataset.path(), "--out", run_});
  EXPECT_EQ(covey.finish(), 0) << covey.output();
  const json agents = summary()["agents"];
  for (const auto& [name, agent] : agents.items())
    EXPECT_EQ(agent["frames"], COVEY_TEST_FLIGHT_FRAMES) << name;
  EXPECT_THAT(file_content(fs::path(run_) / "report.html"), HasSubstr("since its own start"));
}

TEST_F(Team, TheSettingsSayHowToStartUnlessTheCommandDoes) {
  const TemporaryFolder folder;
  const std::string config =
      folder.write("static.json", R"({"initialisation": {"method": "static"}})");
  for (const std::string wanted : {"static", "groundtruth"}) {
    std::vector<std::string> more{"--mode",   "solo", "--agents", "uav0",
                                  "--config", config, "--force"};
    if (wanted != "static") more.insert(more.end(), {"--init", wanted});
    CoveyProcess covey(command(more));
    EXPECT_EQ(covey.finish(), 0) << covey.output();
    EXPECT_EQ(summary()["init"], wanted);
  }
}

TEST_F(Team, UnknownDronesFlagsAndPacesAreBadUsage) {
  CoveyProcess drone(command({"--agents", "uav0,uav9"}));
  EXPECT_EQ(drone.finish(), 1);
  EXPECT_THAT(drone.output(), HasSubstr("no drone 'uav9'"));
  CoveyProcess pace(command({"--pace", "fast"}));
  EXPECT_EQ(pace.finish(), 2);
  EXPECT_THAT(pace.output(), AllOf(HasSubstr("covey: "), HasSubstr("'fast'")));
  CoveyProcess flag(command({"--modes", "solo"}));
  EXPECT_EQ(flag.finish(), 2);
  CoveyProcess exchange(command({"--exchange", "none"}));
  EXPECT_EQ(exchange.finish(), 2);
}

// Why a user without rights finds no domain by lock files in `folder`, or nothing. Only the system
// can tell what another user may do.
std::string complaint_about_locks(const fs::path& folder) {
  const char* before = std::getenv("TMPDIR");
  const std::string temporary = before == nullptr ? "/tmp" : before;
  setenv("TMPDIR", folder.c_str(), 1);
  constexpr uid_t kNobody = 65534;
  const uid_t own = geteuid();
  EXPECT_EQ(seteuid(own == 0 ? kNobody : own), 0);
  std::string complaint;
  try {
    const FreeDomain domain;
  } catch (const std::exception& error) {
    complaint = error.what();
  }
  EXPECT_EQ(seteuid(own), 0);
  setenv("TMPDIR", temporary.c_str(), 1);
  return complaint;
}

constexpr fs::perms kReadByAll =
    fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read;

TEST(FreeDomain, LockFilesOfAnotherUserLockNobodyOut) {
  const TemporaryFolder folder;
  fs::permissions(folder.path(), fs::perms::all | fs::perms::sticky_bit);
  for (int id = 1; id <= 60; ++id) {
    const fs::path file = folder.write("covey-domain-" + std::to_string(id) + ".lock", "");
    fs::permissions(file, kReadByAll);
  }
  EXPECT_EQ(complaint_about_locks(folder.path()), "");
}

TEST(FreeDomain, AFolderThatAllowsNoLockFileIsNamed) {
  const TemporaryFolder folder;
  constexpr fs::perms kEnterByAll =
      fs::perms::owner_exec | fs::perms::group_exec | fs::perms::others_exec;
  fs::permissions(folder.path(), kReadByAll | kEnterByAll);
  EXPECT_THAT(complaint_about_locks(folder.path()),
              AllOf(HasSubstr((folder.path() / "covey-domain-").string()),
                    HasSubstr(".lock cannot be opened: Permission denied"), HasSubstr("TMPDIR")));
}

TEST(FreeDomain, TwoTeamsNeverGetTheSame) {
  const FreeDomain one, other;
  EXPECT_NE(one.id(), other.id());
}

}  // namespace
}  // namespace covey
