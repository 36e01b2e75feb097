// SPDX-License-Identifier: Apache-2.0
#include "apps/png_file.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <string>

namespace covey {
namespace {

std::string scratch(const std::string& name) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "covey_png_file_test";
  std::filesystem::create_directories(folder);
  return (folder / name).string();
}

cv::Mat random_image(int type) {
  cv::Mat image(37, 53, type);
  cv::RNG rng(7);
  rng.fill(image, cv::RNG::UNIFORM, 0, type == CV_8UC1 ? 256 : 65536);
  return image;
}

std::string message_of(const std::string& path) {
  try {
    (void)read_png(path);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(PngFile, ColouredDrawingsAreWrittenRedFirst) {
  const std::string path = scratch("red.png");
  write_png(path, cv::Mat(3, 4, CV_8UC3, cv::Scalar(255, 0, 0)));
  const cv::Mat luma = read_png(path);
  EXPECT_EQ(luma.size(), cv::Size(4, 3));
  EXPECT_EQ(luma.at<std::uint8_t>(1, 2), 76) << "29.9 % of 255, as of red";
}

TEST(PngFile, GreyImagesOfBothDepthsComeBackBitForBit) {
  for (const int type : {CV_8UC1, CV_16UC1}) {
    const cv::Mat image = random_image(type);
    const std::string path = scratch("round_trip.png");
    write_png(path, image);
    const cv::Mat back = read_png(path);
    ASSERT_EQ(back.type(), type);
    ASSERT_EQ(back.size(), image.size());
    EXPECT_EQ(cv::norm(back, image, cv::NORM_INF), 0);
  }
}

TEST(PngFile, PartOfALargerImageIsWrittenAsSeen) {
  const cv::Mat part = random_image(CV_8UC1)(cv::Rect(5, 6, 20, 10));
  const std::string path = scratch("part.png");
  write_png(path, part);
  EXPECT_EQ(cv::norm(read_png(path), part, cv::NORM_INF), 0);
}

TEST(PngFile, MissingFileIsOneLineNamingTheFile) {
  const std::string path = scratch("no_such_file.png");
  const std::string message = message_of(path);
  EXPECT_NE(message.find(path), std::string::npos);
  EXPECT_EQ(message.find('\n'), std::string::npos);
}

TEST(PngFile, CutShortEmptyAndForeignFilesAreRefusedByName) {
  const std::string path = scratch("damaged.png");
  write_png(path, random_image(CV_8UC1));
  std::filesystem::resize_file(path, std::filesystem::file_size(path) / 2);
  EXPECT_NE(message_of(path).find(path), std::string::npos);
  std::filesystem::resize_file(path, 0);
  EXPECT_NE(message_of(path).find("empty"), std::string::npos);
  std::ofstream(path) << "P5 not a png";
  EXPECT_NE(message_of(path).find("not a readable PNG"), std::string::npos);
}

TEST(PngFile, OtherImagesAndUnwritableFoldersAreRefused) {
  EXPECT_THROW(write_png(scratch("float.png"), cv::Mat(4, 4, CV_32FC1)), std::runtime_error);
  EXPECT_THROW(write_png(scratch("no_folder/image.png"), random_image(CV_8UC1)),
               std::runtime_error);
}

}  // namespace
}  // namespace covey
