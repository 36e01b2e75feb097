// SPDX-License-Identifier: Apache-2.0
//
// `covey inspect`, as a person would run it, on a second of a simulated yard.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "apps/inspect_pictures.h"
#include "apps/json_file.h"
#include "apps/png_file.h"
#include "apps/thermal_truth_file.h"
#include "tests/apps/command_run.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string text(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(Inspect, ShowsAThermalFlightRawAndCalibratedAgainstTheTruth) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard", out = folder.path() / "out";
  ASSERT_EQ(
      complaint_of("simulate mars_yard --agents 1 --seconds 1 --rate 15 --out " + yard.string()),
      "");
  ASSERT_EQ(complaint_of("inspect " + yard.string() + " --images 1 --out " + out.string()), "");
  for (const char* picture : {"before_after_1.png", "tracks_1.png", "field.png"}) {
    const cv::Mat image = read_png((out / picture).string());
    EXPECT_GT(image.cols, 2 * 640) << picture;
    EXPECT_EQ(image.rows, 512) << picture;
  }
  for (const char* drawing : {"harris.svg", "tracks.svg", "gain_offset.svg"}) {
    EXPECT_THAT(text(out / drawing), HasSubstr("class=\"curve")) << drawing;
    EXPECT_THAT(text(out / "index.html"), HasSubstr(drawing));
  }
  const nlohmann::json summary = read_json_file(out / "summary.json");
  EXPECT_EQ(summary["drone"], "uav0");
  EXPECT_EQ(summary["images"], 15);
  EXPECT_EQ(summary["thermal"], true);
  EXPECT_GT(summary["calibrated"]["tracks"]["mean_per_frame"], 100);
  EXPECT_LT(summary["calibrated"]["ate_se3_m"], 0.05);
  EXPECT_LT(summary["patch_residual"]["calibrated"], summary["patch_residual"]["raw"]);
  EXPECT_NEAR(summary["pixel_lag_s"], 0.008, 0.004);
  EXPECT_EQ(summary["pattern_share"], 0) << "it hardly moves in this second";
  EXPECT_LT(summary["truth"]["gain_error"]["over_third_of_a_second"]["mean"], 0.05);
}

// What its summary.json says.
nlohmann::json inspected(const fs::path& dataset, const std::string& options, const fs::path& out) {
  EXPECT_EQ(complaint_of("inspect " + dataset.string() + " --images 1 --force " + options +
                         " --out " + out.string()),
            "");
  return read_json_file(out / "summary.json");
}

TEST(Inspect, LeavesImagesRawAsTheCommandOrTheSettingsSay) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard", out = folder.path() / "out";
  ASSERT_EQ(
      complaint_of("simulate mars_yard --agents 1 --seconds 1 --rate 8 --out " + yard.string()),
      "");
  const fs::path raw = folder.write("raw.json", R"({"thermal": {"mode": "raw"}})");
  for (const std::string& options : {std::string("--thermal raw"), "--config " + raw.string()}) {
    const nlohmann::json summary = inspected(yard, options, out);
    EXPECT_EQ(summary["thermal"], true) << options;
    EXPECT_TRUE(summary["calibrated"].is_null()) << options;
    EXPECT_GT(summary["raw"]["tracks"]["mean_per_frame"], 50) << options;
    EXPECT_FALSE(fs::exists(out / "field.png")) << options;
    EXPECT_EQ(read_png((out / "tracks_1.png").string()).cols, 640) << options;
  }
  const nlohmann::json both = inspected(yard, "--thermal calibrated --config " + raw.string(), out);
  EXPECT_FALSE(both["calibrated"].is_null()) << "the command's word goes first";
}

TEST(Inspect, CalibratesACameraThatItIsToldIsThermal) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard", out = folder.path() / "out";
  ASSERT_EQ(complaint_of("simulate castle_parallel --agents 1 --seconds 1 --rate 8 --out " +
                         yard.string()),
            "");
  EXPECT_EQ(inspected(yard, "", out)["thermal"], false);
  const nlohmann::json summary = inspected(yard, "--thermal calibrated", out);
  EXPECT_EQ(summary["thermal"], true);
  EXPECT_GT(summary["calibrated"]["tracks"]["mean_per_frame"], 50);
  EXPECT_TRUE(fs::exists(out / "before_after_1.png"));
}

TEST(Inspect, KeepsOnlyTheLastFieldAsLargeAsTheImage) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard";
  ASSERT_EQ(
      complaint_of("simulate mars_yard --agents 1 --seconds 1 --rate 8 --out " + yard.string()),
      "");
  const Inspection inspection = inspect_flight(find_drones(yard).front(), InspectionConfig(),
                                               [](std::size_t, std::size_t) {});
  ASSERT_GE(inspection.fields.size(), 2u);
  EXPECT_EQ(inspection.fields.front().field.size(), cv::Size(640, 512) / kTruthCell);
  EXPECT_EQ(inspection.fields.back().field.size(), cv::Size(640, 512));
}

// The truth has fields twice a second, whatever the estimate could see meanwhile.
TEST(Inspect, KeepsFieldsOfTheImagesThatItIsAskedFor) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard";
  ASSERT_EQ(
      complaint_of("simulate mars_yard --agents 1 --seconds 1 --rate 8 --out " + yard.string()),
      "");
  const DroneFolder drone = find_drones(yard).front();
  const std::vector<ThermalTruthRecord> truth = read_thermal_truth(drone.mav0).value();
  EXPECT_EQ(field_stamps(truth), (std::vector<TimeNs>{truth[0].stamp_ns, truth[4].stamp_ns}));
  InspectionConfig config;
  config.field_stamps = {truth[2].stamp_ns - 1, truth[3].stamp_ns, truth[4].stamp_ns};
  const auto fields = inspect_flight(drone, config, [](std::size_t, std::size_t) {}).fields;
  ASSERT_EQ(fields.size(), 2u);
  EXPECT_EQ(fields[0].stamp_ns, truth[3].stamp_ns);
  EXPECT_EQ(fields[1].stamp_ns, truth[4].stamp_ns);
}

// As a flight does.
TEST(Inspect, LeavesOutImagesThatCannotBeRead) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard", out = folder.path() / "out";
  ASSERT_EQ(
      complaint_of("simulate mars_yard --agents 1 --seconds 1 --rate 8 --out " + yard.string()),
      "");
  const std::vector<ImageEntry> images = read_dataset(yard / "uav0" / "mav0").images;
  for (const std::size_t damaged : {0, 3}) fs::resize_file(images[damaged].path, 50);
  ASSERT_EQ(complaint_of("inspect " + yard.string() + " --images 1 --out " + out.string()), "");
  const nlohmann::json summary = read_json_file(out / "summary.json");
  EXPECT_EQ(summary["images"], 8);
  EXPECT_EQ(summary["left_out"], 2);
  EXPECT_GT(summary["calibrated"]["tracks"]["mean_per_frame"], 100);
}

TEST(Inspect, ForceReplacesAReportAndNothingElse) {
  const TemporaryFolder folder;
  const fs::path yard = folder.path() / "yard", out = folder.path() / "out";
  ASSERT_EQ(
      complaint_of("simulate mars_yard --agents 1 --seconds 1 --rate 8 --out " + yard.string()),
      "");
  const std::string again = "inspect " + yard.string() + " --images 1 --force --out ";
  ASSERT_EQ(complaint_of(again + out.string()), "");
  EXPECT_EQ(complaint_of(again + out.string()), "") << "all that it writes may go";
  for (const char* own : {"thesis.tex", "tracks_two.png"}) {
    const fs::path mine = folder.write(fs::path("out") / own, "precious");
    EXPECT_THAT(complaint_of(again + out.string()), HasSubstr("there is something else")) << own;
    EXPECT_EQ(text(mine), "precious");
    fs::remove(mine);
  }
  const fs::path site = folder.write("web/index.html", "<title>Mine</title>");
  (void)folder.write("web/summary.json", "{}");
  EXPECT_THAT(complaint_of(again + site.parent_path().string()),
              HasSubstr("there is something else"));
  EXPECT_EQ(text(site), "<title>Mine</title>");
}

TEST(Inspect, SaysInOneLineWhatIsWrongAndLeavesNothing) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "out";
  const std::string to = " --out " + out.string();
  EXPECT_THAT(complaint_of("inspect " + folder.path().string() + to), HasSubstr("holds no drone"));
  const fs::path yard = folder.path() / "yard";
  ASSERT_EQ(complaint_of("simulate castle_parallel --agents 1 --seconds 1 --rate 2 --out " +
                         yard.string()),
            "");
  EXPECT_THAT(complaint_of("inspect " + yard.string() + " --agent uav7" + to),
              HasSubstr("holds no drone 'uav7': --agent takes one of uav0"));
  EXPECT_THAT(complaint_of("inspect " + yard.string() + " --force --out " + yard.string()),
              HasSubstr("there is something else"));
  fs::resize_file(find_drones(yard)[0].mav0 / "imu0" / "data.csv", 100);
  EXPECT_NE(complaint_of("inspect " + yard.string() + to), "");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1)
      << "only the yard";
}

TEST(Inspect, DrawsTracksInThePapersColours) {
  Picture picture{0, cv::Mat(40, 90, CV_8UC1, cv::Scalar(0)), {}};
  picture.tracks = {{{20, 20}, TrackKind::kSlam},
                    {{45, 20}, TrackKind::kMsckf},
                    {{70, 20}, TrackKind::kOpportunistic}};
  const cv::Mat drawing = draw_tracks(picture, cv::Mat());
  const auto colour = [&](int x) { return drawing.at<cv::Vec3b>(20, x + 4); };  // on the ring
  EXPECT_GT(colour(20)[2], 200) << "blue";
  EXPECT_LT(colour(20)[0], 100);
  EXPECT_GT(colour(45)[0], 200) << "orange";
  EXPECT_LT(colour(45)[2], 100);
  EXPECT_GT(colour(70)[2], colour(70)[1] + 100) << "purple";
  EXPECT_GT(colour(70)[0], colour(70)[1] + 80);
  EXPECT_EQ(drawing.at<cv::Vec3b>(20, 20), cv::Vec3b(0, 0, 0)) << "the corner itself stays free";
}

TEST(Inspect, ShowsWhatTheMaskLeavesOut) {
  const Picture picture{0, cv::Mat(40, 90, CV_8UC1, cv::Scalar(100)), {}};
  cv::Mat mask(40, 90, CV_8UC1, cv::Scalar(255));
  mask.colRange(0, 10).setTo(0);
  const cv::Mat drawing = draw_tracks(picture, mask);
  EXPECT_EQ(drawing.at<cv::Vec3b>(20, 9), cv::Vec3b(160, 40, 40));
  EXPECT_EQ(drawing.at<cv::Vec3b>(20, 10), cv::Vec3b(100, 100, 100));
}

TEST(CornerHistogram, ContrastMovesItToStrongerResponses) {
  cv::Mat weak(64, 64, CV_8UC1, cv::Scalar(100));
  for (int i = 8; i < 64; i += 16) {
    for (int j = 8; j < 64; j += 16) weak(cv::Rect(i, j, 6, 6)).setTo(110);
  }
  const auto strongest = [](const cv::Mat& image) {
    CornerHistogram corners;
    corners.add(image);
    int bin = CornerHistogram::kBins - 1;
    while (bin > 0 && corners.shares[static_cast<std::size_t>(bin)] == 0) --bin;
    return CornerHistogram::middle(bin);
  };
  // Ten times the contrast: ten thousand times the response.
  EXPECT_NEAR(strongest((weak - 100) * 10 + 100) - strongest(weak), 4, 0.21) << "a bin is 0.2";
}

}  // namespace
}  // namespace covey
