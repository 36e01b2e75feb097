// SPDX-License-Identifier: Apache-2.0
#include "apps/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <regex>
#include <stdexcept>

#include "apps/png_file.h"
#include "apps/report_data.h"
#include "apps/run_files.h"
#include "apps/run_summary.h"
#include "apps/svg.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing::ThrowsMessage;

constexpr int kImages = 90;  // at 30 Hz

Pose pose_at(int image, double offset_m) {
  const double angle = 2 * M_PI * image / kImages;
  return {{10 * std::cos(angle) + offset_m * std::sin(9 * angle), 10 * std::sin(angle), 5},
          Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()))};
}

constexpr TimeNs kStart_ns = 1403636579763555527;
TimeNs stamp_of(int image, TimeNs start_ns = kStart_ns) {
  return start_ns + image * TimeNs{33333333};
}

// The error of the estimate is a wave of this height.
void write_flight(const fs::path& folder, double offset_m, TimeNs start_ns = kStart_ns) {
  fs::create_directories(folder);
  OdometryWriter writer(folder);
  for (int i = 10; i < kImages; ++i) {
    Odometry odometry;
    odometry.stamp_ns = stamp_of(i, start_ns);
    odometry.pose = pose_at(i, offset_m);
    odometry.pose_covariance = 0.01 * Matrix6d::Identity();
    writer.write(odometry);
  }
}

void write_truth(const fs::path& folder, TimeNs start_ns = kStart_ns) {
  StampedPoses truth;
  for (int i = 0; i < kImages; ++i) truth.push_back({stamp_of(i, start_ns), pose_at(i, 0)});
  write_tum(folder / kGroundTruthFile, truth);
}

void write_records(const fs::path& folder, TimeNs start_ns = kStart_ns) {
  TimingWriter timings(folder);
  LinkWriter link(folder);
  for (int i = 0; i < kImages; ++i) {
    TimingRecord timing;
    timing.stamp_ns = stamp_of(i, start_ns);
    timing.track_ms = 3 + std::sin(i);
    timing.slam_ms = 1;
    timing.tracks = 180 + i % 7;
    timings.write(timing);
    LinkRecord record;
    record.stamp_ns = stamp_of(i, start_ns);
    record.requests_sent = i / 15;
    record.payload_bytes_sent = 2056 * record.requests_sent;
    link.write(record);
  }
}

class Report : public testing::Test {
 protected:
  Report() {
    summary_.dataset = "a <script>alert(1)</script> & \"b\"";
    summary_.mode = "collaborative";
    summary_.exchange = "compact";
    summary_.init = "static";
    for (const char* name : {"uav0", "uav1"}) {
      write_flight(run() / name, 0.1);
      write_flight(run() / kSoloFolder / name, 0.2);
      write_truth(run() / name);
      write_records(run() / name);
      AgentSummary agent;
      agent.frames = kImages;
      agent.link = LinkSummary();
      agent.link->message.sent = 4711;
      if (name == std::string("uav1")) agent.link->clocks = {{"<uav0>", {-3000.25, 1.5}}};
      summary_.agents[name] = agent;
    }
    write_run_summary(run() / "summary.json", summary_);
  }

  [[nodiscard]] const fs::path& run() const { return folder_.path(); }

  void write_camera(const std::string& drone, const json& camera) const {
    folder_.write(drone + "/agent_summary.json", json{{"camera", camera}}.dump());
  }

  [[nodiscard]] std::string drawn() const {
    std::ifstream stream(write_report(run()));
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  TemporaryFolder folder_;
  RunSummary summary_;
};

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
  return found;
}

TEST_F(Report, ShowsErrorsTogetherAndAloneAndTheChange) {
  const std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("<td>0.141</td><td class=\"main\">0.071</td>"));
  EXPECT_THAT(html, HasSubstr("\u25bc 50 %"));
  EXPECT_THAT(html, HasSubstr("4711"));
}

TEST_F(Report, ShowsHowFarPeersClocksAreOff) {
  EXPECT_THAT(drawn(), HasSubstr("<td>&lt;uav0&gt;</td><td>\u22123000.25</td><td>1.50</td>"));
}

TEST_F(Report, OfWorldsOfTheirOwnItSaysWhereTheyLie) {
  EXPECT_THAT(drawn(),
              AllOf(HasSubstr("the world the drones share"), Not(HasSubstr("worlds lie"))));
  summary_.agents["uav0"].alignments = {{"uav1", {0.012, 0.05, 0.02, 0.08}}};
  summary_.agents["uav1"].alignments.emplace();
  write_run_summary(run() / "summary.json", summary_);
  EXPECT_THAT(drawn(), AllOf(HasSubstr("<td>uav1</td><td>0.012</td><td>0.020</td><td>0.05</td>"),
                             HasSubstr("none found"), HasSubstr("the world of its own start"),
                             Not(HasSubstr("the world the drones share")),
                             Not(HasSubstr("the shared world"))));
}

TEST_F(Report, SaysWhyADroneDidNotStart) {
  summary_.agents["uav1"].not_started = "it <never> stood still";
  write_run_summary(run() / "summary.json", summary_);
  write_tum(run() / "uav1" / kTrajectoryFile, {});
  EXPECT_THAT(drawn(), AllOf(HasSubstr("<li>uav1 did not start: it &lt;never&gt; stood still"),
                             Not(HasSubstr("holds no pose"))));
}

TEST_F(Report, SaysOfHowManyPosesErrorsAre) {
  EXPECT_THAT(drawn(), Not(HasSubstr("the ground truth covers")));
  StampedPoses half;
  for (int i = 0; i < kImages / 2; ++i) half.push_back({stamp_of(i), pose_at(i, 0)});
  write_tum(run() / "uav1" / kGroundTruthFile, half);
  EXPECT_THAT(drawn(), HasSubstr("<li>uav1: the ground truth covers 35 of 80 poses"));
}

// Whose path is short has hardly a yaw to be fitted.
TEST_F(Report, RotationIsThatOfTheWorldAsItStands) {
  StampedPoses turned;
  for (int i = 10; i < kImages; ++i) {
    Pose pose = pose_at(i, 0);
    pose.q_world_imu = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitZ()) * pose.q_world_imu;
    turned.push_back({stamp_of(i), pose});
  }
  for (const char* name : {"uav0", "uav1"}) write_tum(run() / name / kTrajectoryFile, turned);
  EXPECT_THAT(drawn(), HasSubstr("<td>5.73</td>")) << "0.1 rad";
}

TEST_F(Report, DrawsEverySectionForEveryDrone) {
  const std::string html = drawn();
  for (const char* heading : {"Errors", "Trajectories", "Distance to the truth",
                              "What the filters believe", "Work", "Link"}) {
    EXPECT_THAT(html, HasSubstr("<h2>" + std::string(heading) + "</h2>"));
  }
  // Three views; for each of two drones a distance, four channels, three of work, three of the
  // link.
  EXPECT_EQ(count(html, "class=\"chart\""), 3u + 2 * (1 + 4 + 3 + 3));
}

TEST_F(Report, ShowsGainsAndFieldOfThermalCameras) {
  EXPECT_THAT(drawn(), Not(HasSubstr("Thermal calibration")));
  ThermalWriter writer(run() / "uav1");
  for (int i = 0; i < kImages; ++i) {
    const TimeNs chain_ns = stamp_of(i < 40 ? 0 : 40);
    writer.write({stamp_of(i), chain_ns, {1 + 0.01 * (i % 40), 3.0 - i}});
  }
  cv::Mat field(64, 80, CV_32FC1, cv::Scalar(-0.5));
  field(cv::Rect(0, 0, 40, 64)) = 2;
  write_field(run() / "uav1", field);
  const std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("<h2>Thermal calibration</h2>"));
  EXPECT_EQ(count(html, ">gain</text>"), 1u) << "of the one drone that has it";
  EXPECT_THAT(html, HasSubstr("2 grey levels either way"));
  EXPECT_EQ(count(html, "fill-opacity=\"1.00\""), 20u * 32);
  EXPECT_EQ(count(html, "fill-opacity=\"0.25\""), 20u * 32);
  EXPECT_EQ(read_thermal(run() / "uav1" / kThermalFile).back().chain_ns, stamp_of(40));

  for (const char* ragged : {"1,2\n3\n", "1\n2,3\n"}) {
    std::ofstream(run() / "uav1" / kFieldFile) << ragged;
    EXPECT_THAT(drawn(), HasSubstr("thermal_field.csv:2"));
  }
}

TEST_F(Report, ShowsPicturesAndCornersOfThermalFlights) {
  ThermalWriter(run() / "uav1").write({stamp_of(0), stamp_of(0), {1, 0}});
  std::string html = drawn();
  EXPECT_THAT(html, Not(HasSubstr("<img"))) << "a live flight, say";
  EXPECT_THAT(html, Not(HasSubstr("corner response</")));
  const std::string file = (run() / "uav1" / kPicturesFile).string();
  write_png(file, cv::Mat(30, 40, CV_8UC3, cv::Scalar(10, 20, 30)));
  write_corners(run() / "uav1", {{-8.9, 0.25, 0.125}, {-8.7, 0.5, 0.0625}});
  html = drawn();
  EXPECT_THAT(html, HasSubstr("<img alt=\"raw and calibrated images and tracks of uav1\" "
                              "src=\"data:image/png;base64,iVBORw0KGgo"))
      << "how each PNG begins";
  EXPECT_EQ(count(html, "<img"), 1u);
  EXPECT_EQ(count(html, ">corner response</text>"), 1u);
  EXPECT_EQ(read_corners(run() / "uav1" / kCornersFile)[1].calibrated, 0.0625);

  std::filesystem::resize_file(file, 60);
  html = drawn();
  EXPECT_THAT(html, HasSubstr("<li>uav1/thermal_pictures.png: "));
  EXPECT_THAT(html, Not(HasSubstr("<img")));
}

// As a drone tells it that calibrated nothing.
json camera_as_believed() {
  const json believed = {{"time_offset_s", 0.001},
                         {"time_offset_sigma_s", 0.0},
                         {"p_imu_cam_m", {0.09, 0.02, -0.03}},
                         {"p_imu_cam_sigma_m", {0.0, 0.0, 0.0}},
                         {"q_imu_cam_xyzw", {0.5, -0.5, 0.5, -0.5}},
                         {"q_imu_cam_sigma_deg", {0.0, 0.0, 0.0}},
                         {"intrinsics_px", {455.0, 456.0, 375.5, 239.5}},
                         {"intrinsics_sigma_px", {0.0, 0.0, 0.0, 0.0}},
                         {"distortion", {-0.28, 0.07, 0.0, 0.0}},
                         {"k1_k2_sigma", {0.0, 0.0}}};
  json camera = believed;
  camera["at_start"] = believed;
  return camera;
}

json found_camera() {
  json camera = camera_as_believed();
  camera["time_offset_s"] = -0.0015;
  camera["time_offset_sigma_s"] = 0.00004;
  camera["intrinsics_px"] = {455.5, 452.75, 375.25, 239.75};
  camera["intrinsics_sigma_px"] = {0.15, 0.14, 0.09, 0.1};
  camera["at_start"]["time_offset_sigma_s"] = 0.005;
  camera["at_start"]["intrinsics_sigma_px"] = {1.0, 1.0, 1.0, 1.0};
  return camera;
}

TEST_F(Report, ShowsWhatEachCameraTurnedOutToBe) {
  write_camera("uav1", found_camera());
  const std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("<h2>What each camera turned out to be</h2>"));
  EXPECT_THAT(html, HasSubstr("uav0</td><td>\u2013</td><td>\u2013</td><td>\u2013</td></tr>"));
  EXPECT_THAT(html, HasSubstr("<td>\u22122.500 \u00b1 0.040</td><td>+0.50 \u00b1 0.15<br>"));
  EXPECT_THAT(html, HasSubstr("<td>\u22120.25 \u00b1 0.09<br>+0.25 \u00b1 0.10</td>"));
  for (const char* column : {"rotation \u00b0", "lever arm mm", "<th>k1</th>", "<th>k2</th>"})
    EXPECT_THAT(html, Not(HasSubstr(column))) << "not calibrated";
}

TEST_F(Report, MarksWhatIsFurtherOffThanTheSettingsLeadToExpect) {
  json camera = found_camera();
  write_camera("uav0", camera);
  write_camera("uav1", camera);
  std::string html = drawn();
  EXPECT_EQ(count(html, "worth a new calibration</span>"), 2u) << "once for each drone";
  EXPECT_THAT(html, HasSubstr("<br><span class=\"worse\">\u22123.25 \u00b1 0.14</span></td>"));
  camera["intrinsics_px"][1] = 453.25;
  write_camera("uav1", camera);
  html = drawn();
  EXPECT_EQ(count(html, "worth a new calibration</span>"), 1u);
  EXPECT_THAT(html, HasSubstr("<br>\u22122.75 \u00b1 0.14</td>"));
}

TEST_F(Report, ShowsNoCamerasWhereNothingWasCalibrated) {
  EXPECT_THAT(drawn(), Not(HasSubstr("What each camera"))) << "no summary of any drone";
  folder_.write("uav0/agent_summary.json", "{}");
  write_camera("uav1", camera_as_believed());
  EXPECT_THAT(drawn(), AllOf(Not(HasSubstr("What each camera")), Not(HasSubstr("<li>uav"))));
  json camera = found_camera();
  camera.erase("at_start");
  write_camera("uav1", camera);
  EXPECT_THAT(drawn(), AllOf(Not(HasSubstr("What each camera")), Not(HasSubstr("<li>uav"))));
}

TEST_F(Report, NamesACameraThatIsNoneAndDrawsTheOthers) {
  json camera = found_camera();
  write_camera("uav0", camera);
  camera["time_offset_s"] = "<i>late";
  write_camera("uav1", camera);
  std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("<li>uav1/agent_summary.json: camera the value of "
                              "&#39;time_offset_s&#39; is of the wrong type</li>"));
  EXPECT_THAT(html, HasSubstr("<td>\u22122.500 \u00b1 0.040</td>"));
  EXPECT_THAT(html, HasSubstr("uav1</td><td>\u2013</td>"));
  folder_.write("uav0/agent_summary.json", "{\"camera\": {\"time_offset_s\": nan}}");
  html = drawn();
  EXPECT_THAT(html, HasSubstr("<li>uav0/agent_summary.json: not valid JSON"));
  EXPECT_THAT(html, Not(HasSubstr("What each camera")));
}

TEST_F(Report, IsSelfContained) {
  const std::string html = drawn();
  for (const char* outside : {"http", "src=", "href=", "url(", "@import", "<script", "<link"}) {
    EXPECT_THAT(html, Not(HasSubstr(outside)));
  }
}

TEST_F(Report, EscapesEveryName) {
  summary_.agents["<b>uav2"] = AgentSummary();
  summary_.agents["uav0"].incomplete = "died: <i>";
  write_run_summary(run() / "summary.json", summary_);
  const std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("a &lt;script&gt;alert(1)&lt;/script&gt; &amp; &quot;b&quot;"));
  EXPECT_THAT(html, HasSubstr("&lt;b&gt;uav2"));
  EXPECT_THAT(html, AllOf(HasSubstr("died: &lt;i&gt;"), Not(HasSubstr("<i>"))));
}

TEST_F(Report, LeavesOutWhatIsMissingWithAWord) {
  for (const char* file :
       {kTrajectoryFile, kCovarianceFile, kGroundTruthFile, kTimingsFile, kLinkFile}) {
    for (const char* name : {"uav0", "uav1"}) {
      fs::remove(run() / name / file);
      EXPECT_THAT(drawn(), HasSubstr("</html>"));
    }
  }
  fs::remove_all(run() / "uav0");
  fs::remove_all(run() / kSoloFolder);
  const std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("<li>uav0/trajectory.tum: cannot be read"));
  EXPECT_THAT(html, HasSubstr("<li>uav1: no ground truth"));
  EXPECT_THAT(html, Not(HasSubstr("Trajectories")));
}

TEST_F(Report, NamesABrokenFileAndDrawsTheRest) {
  folder_.write("uav0/timings.csv", "stamp_ns,read_ms\n");
  folder_.write("uav1/trajectory.tum", "1 0 0 0 0 0 0 1\n2 0 0 nan 0 0 0 1\n");
  const std::string html = drawn();
  EXPECT_THAT(html, HasSubstr("<li>uav0/timings.csv:1: column &#39;thermal_ms&#39; is missing"));
  EXPECT_THAT(html, HasSubstr("<li>uav1/trajectory.tum:2: column 4 is not finite"));
  EXPECT_THAT(html, HasSubstr("error in yaw"));
}

TEST_F(Report, SaysWhenTruthAndEstimateDoNotOverlap) {
  StampedPoses other;
  for (int i = 0; i < 9; ++i) other.push_back({TimeNs{1000000000} * (i + 1), {}});
  write_tum(run() / "uav0" / kGroundTruthFile, other);
  EXPECT_THAT(drawn(), HasSubstr("<li>uav0: only 0 poses match in time"));
}

TEST_F(Report, DrawsDronesOfClocksThatAreYearsApartEachOverItsOwnTime) {
  EXPECT_THAT(drawn(), AllOf(HasSubstr(">time, s<"), Not(HasSubstr("its own start"))));
  constexpr TimeNs kSinceBoot_ns = 1000'000'000'000;
  fs::remove_all(run() / kSoloFolder / "uav1");
  write_flight(run() / "uav1", 0.1, kSinceBoot_ns);
  write_truth(run() / "uav1", kSinceBoot_ns);
  write_records(run() / "uav1", kSinceBoot_ns);
  const std::string html = drawn();
  EXPECT_THAT(html, AllOf(HasSubstr(">time since its own start, s<"), HasSubstr("payload sent")));
  EXPECT_THAT(html, Not(HasSubstr(">time, s<")));
  EXPECT_THAT(html, HasSubstr("<li>the drones flew at times far apart"));
}

TEST_F(Report, DividesWhatADroneSendsByItsOwnFlight) {
  constexpr TimeNs kLater_ns = kStart_ns + 2'000'000'000;
  write_flight(run() / "uav1", 0.1, kLater_ns);
  write_records(run() / "uav1", kLater_ns);
  const RunData data = read_run(run());
  EXPECT_NEAR(seconds_between(data.start_ns, data.end_ns), 2 + 89 / 30.0, 1e-3);
  for (const AgentRun& agent : data.agents) {
    EXPECT_NEAR(flown_s(agent).value(), 89 / 30.0, 1e-3) << agent.name;
  }
  EXPECT_FALSE(flown_s({}).has_value());
}

TEST_F(Report, DrawsAFlightWithOneStampThatIsYearsOff) {
  for (const char* name : {"uav0", "uav1"}) {
    TimingWriter timings(run() / name);
    LinkWriter link(run() / name);
    for (const TimeNs stamp_ns : {TimeNs{1000}, TimeNs{2000}, kStart_ns}) {
      TimingRecord timing;
      timing.stamp_ns = stamp_ns;
      timings.write(timing);
      LinkRecord record;
      record.stamp_ns = stamp_ns;
      record.payload_bytes_sent = 2056;
      link.write(record);
    }
  }
  EXPECT_THAT(drawn(), AllOf(HasSubstr("payload sent"), Not(HasSubstr("nan"))));
}

TEST_F(Report, OfARunWithoutSummaryIsAnError) {
  fs::remove(run() / "summary.json");
  EXPECT_THAT([this] { (void)write_report(run()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("summary.json: cannot be read")));
}

// ------------------------------------------------------------------------------------------- svg

TEST(Svg, TicksAreRoundAndInside) {
  EXPECT_DOUBLE_EQ(round_step(10, 5), 2);
  EXPECT_DOUBLE_EQ(round_step(0.3, 4), 0.1);
  EXPECT_DOUBLE_EQ(round_step(6e6, 10), 1e6);
  EXPECT_THAT(multiples(2, {-3.9, 4}), ElementsAre(-2, 0, 2, 4));
}

TEST(Svg, TextIsEscaped) {
  EXPECT_EQ(escape_html("<a b='\"&'>"), "&lt;a b=&#39;&quot;&amp;&#39;&gt;");
}

TEST(Svg, SimplifyingKeepsCornersAndDropsWhatIsOnTheLine) {
  std::vector<Eigen::Vector2d> corner;
  for (int i = 0; i <= 10; ++i) corner.emplace_back(i, 0);
  for (int i = 1; i <= 10; ++i) corner.emplace_back(10, i);
  EXPECT_THAT(simplified(corner, 0.1),
              ElementsAre(Eigen::Vector2d(0, 0), Eigen::Vector2d(10, 0), Eigen::Vector2d(10, 10)));
}

TEST(Svg, SimplifyingKeepsALoopThatEndsWhereItBegan) {
  EXPECT_EQ(simplified({{0, 0}, {5, 0}, {5, 5}, {0, 0}}, 0.1).size(), 4u);
}

// Width and height of the only curve, px.
Eigen::Vector2d drawn_size(const std::string& svg) {
  std::smatch path;
  EXPECT_TRUE(std::regex_search(svg, path, std::regex("class=\"curve\"[^>]* d=\"([^\"]*)\"")));
  const std::string data = path[1];
  const std::regex point("[ML]([-0-9.]+) ([-0-9.]+)");
  Eigen::AlignedBox2d box;
  for (auto it = std::sregex_iterator(data.begin(), data.end(), point);
       it != std::sregex_iterator(); ++it) {
    box.extend(Eigen::Vector2d(std::stod((*it)[1]), std::stod((*it)[2])));
  }
  return box.sizes();
}

TEST(Svg, OnEqualScalesASquareIsASquare) {
  Chart chart;
  chart.equal_scale = true;
  Curve square;
  square.color = "ink";
  square.points = {{0, 0}, {10, 0}, {10, 10}, {0, 10}, {0, 0}};
  chart.curves.push_back(square);
  for (const double max_height_px : {0.0, 1000.0}) {
    chart.max_height_px = max_height_px;
    const Eigen::Vector2d size = drawn_size(render_svg(chart));
    EXPECT_NEAR(size.x(), size.y(), 0.2);
  }
}

TEST(Svg, ConstantAndSingleValuesStillHaveAxes) {
  Chart chart;
  Curve constant;
  constant.color = "ink";
  constant.points = {{0, 3}, {1, 3}};
  chart.curves = {constant};
  EXPECT_THAT(render_svg(chart), AllOf(HasSubstr(">3<"), Not(HasSubstr("nan"))));
  chart.curves[0].points = {{5, 0}};
  chart.y_from_zero = true;
  EXPECT_THAT(render_svg(chart), AllOf(HasSubstr("</svg>"), Not(HasSubstr("nan"))));
}

TEST(Svg, NothingToDrawIsNothing) { EXPECT_EQ(render_svg(Chart()), ""); }

}  // namespace
}  // namespace covey
