// SPDX-License-Identifier: Apache-2.0
#include "apps/thermal_truth_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <string>

#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using ::testing::HasSubstr;

std::string complaint(const TemporaryFolder& folder, const std::string& line) {
  folder.write("thermal_truth0/data.csv", line);
  try {
    (void)read_thermal_truth(folder.path());
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(ThermalTruthFile, ComesBackAsItWasWritten) {
  const TemporaryFolder folder;
  ThermalTruth truth;
  truth.black_k = 280.25;
  truth.white_k = 291.5;
  truth.pattern_k = cv::Mat(32, 48, CV_32FC1, cv::Scalar(-0.4));
  truth.pattern_k.colRange(16, 32).setTo(0.7);
  ThermalTruthWriter writer(folder.path());
  writer.write(nanoseconds(1), truth);
  truth.shutter_closed = true;
  writer.write(nanoseconds(1.1), truth);
  writer.close();
  const auto records = read_thermal_truth(folder.path());
  ASSERT_TRUE(records.has_value());
  ASSERT_EQ(records->size(), 2u);
  EXPECT_EQ((*records)[0].stamp_ns, nanoseconds(1));
  EXPECT_NEAR((*records)[0].black_k, 280.25, 1e-6);
  EXPECT_NEAR((*records)[0].white_k, 291.5, 1e-6);
  EXPECT_FALSE((*records)[0].shutter_closed);
  EXPECT_TRUE((*records)[1].shutter_closed);
  EXPECT_TRUE((*records)[1].field.empty()) << "twice a second";
  const cv::Mat field = read_true_field((*records)[0].field);
  ASSERT_EQ(field.size(), cv::Size(3, 2));
  EXPECT_NEAR(field.at<float>(1, 0), -0.4, 1e-3);
  EXPECT_NEAR(field.at<float>(0, 1), 0.7, 1e-3);
}

TEST(ThermalTruthFile, IsAbsentFromRecordedFlights) {
  EXPECT_FALSE(read_thermal_truth(TemporaryFolder().path()).has_value());
}

TEST(ThermalTruthFile, ComplaintsNameFileAndLine) {
  const TemporaryFolder folder;
  EXPECT_THAT(complaint(folder, "# header\n100,280,290\n"), HasSubstr("data.csv:2"));
  EXPECT_THAT(complaint(folder, "100,280,warm,0,-\n"), HasSubstr("data.csv:1"));
  EXPECT_THAT(complaint(folder, "100,290,280,0,-\n"), HasSubstr("white is not warmer than black"));
  EXPECT_THAT(complaint(folder, "100,280,290,0,-\n100,280,290,0,-\n"), HasSubstr("data.csv:2"));
}

}  // namespace
}  // namespace covey
