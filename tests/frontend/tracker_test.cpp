// SPDX-License-Identifier: Apache-2.0
#include "frontend/tracker.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <string>

#include "tests/frontend/synthetic_view.h"

namespace covey {
namespace {

using testing_view::CameraPose;
using testing_view::frame_time;
using testing_view::kFramePeriod;
using testing_view::rotation_between;
using testing_view::SlantedPlane;
using testing_view::small_camera;
using testing_view::swaying_pose;

double quantile(std::vector<double> values, double part) {
  if (values.empty()) return 1e9;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

TrackerConfig small_config() {
  TrackerConfig config;
  config.max_tracks = 80;
  return config;
}

int count_longer_than(const TrackedFrame& frame, int images) {
  return static_cast<int>(
      std::count_if(frame.features.begin(), frame.features.end(),
                    [&](const TrackedFeature& feature) { return feature.length > images; }));
}

// Tracks a scene and remembers where each track's point truly lies.
class Flight {
 public:
  explicit Flight(const TrackerConfig& config = small_config(), const cv::Mat& mask = cv::Mat())
      : scene(small_camera()), tracker(config, small_camera(), mask) {}

  TrackedFrame step(const CameraPose& pose, const cv::Mat& image) {
    const Eigen::Matrix3d R = rotation_between(previous_, pose);
    const TrackedFrame frame = tracker.track(frames_ * kFramePeriod, image, R);
    ++frames_;
    previous_ = pose;
    for (const TrackedFeature& feature : frame.features) {
      if (feature.length == 1) births_[feature.track_id] = scene.point(pose, feature.bearing);
    }
    return frame;
  }

  TrackedFrame step(const CameraPose& pose) {
    return step(pose, scene.image(pose, 1.5, static_cast<int>(frames_) + 1));
  }

  [[nodiscard]] std::vector<double> errors(const CameraPose& pose, const TrackedFrame& frame,
                                           int min_length) const {
    std::vector<double> errors;
    for (const TrackedFeature& feature : frame.features) {
      if (feature.length < min_length) continue;
      errors.push_back((scene.pixel(pose, births_.at(feature.track_id)) - feature.pixel).norm());
    }
    return errors;
  }

  SlantedPlane scene;
  Tracker tracker;

 private:
  CameraPose previous_;
  std::int64_t frames_ = 0;
  std::map<std::uint64_t, Eigen::Vector3d> births_;
};

TEST(Tracker, FollowsItsPointsToATenthOfAPixelHoweverLongTheTrack) {
  Flight flight;
  std::vector<double> young, old;
  for (int k = 0; k < 60; ++k) {
    const CameraPose pose = swaying_pose(frame_time(k));
    const TrackedFrame frame = flight.step(pose);
    if (k == 5) young = flight.errors(pose, frame, 5);
    if (k == 59) old = flight.errors(pose, frame, 50);
  }
  ASSERT_GE(young.size(), 50u);
  ASSERT_GE(old.size(), 20u);
  EXPECT_LT(quantile(young, 0.5), 0.1);
  EXPECT_LT(quantile(young, 0.9), 0.25);
  EXPECT_LT(quantile(old, 0.5), 0.12);
  EXPECT_LT(quantile(old, 0.9), 0.3);
}

TEST(Tracker, KeepsTracksWhileTheImageGrowsToTwiceItsSize) {
  Flight flight;
  TrackedFrame frame;
  CameraPose pose;
  for (int k = 0; k < 45; ++k) {
    pose.p_world_cam.z() = 2.0 * k / 44;
    frame = flight.step(pose);
  }
  const std::vector<double> errors = flight.errors(pose, frame, 40);
  ASSERT_GE(errors.size(), 10u);
  EXPECT_LT(quantile(errors, 0.5), 0.4);
}

TEST(Tracker, FindsFastTurningTracksByTheGyroAlone) {
  // 3 rad/s: 20 px from image to image at the centre, more at the edge.
  Flight flight;
  CameraPose pose;
  TrackedFrame frame = flight.step(pose);
  const int before = static_cast<int>(frame.features.size());
  pose.R_world_cam = exp_so3({0, 0.1, 0});
  frame = flight.step(pose);
  EXPECT_GE(count_longer_than(frame, 1), before * 7 / 10);  // the rest left the image
  EXPECT_LT(quantile(flight.errors(pose, frame, 2), 0.5), 0.1);
}

TEST(Tracker, LearnsAConstantMotionWithoutAnyGyro) {
  SlantedPlane scene(small_camera());
  Tracker tracker(small_config(), small_camera());
  TrackedFrame frame;
  int kept = 0, asked = 0;
  for (int k = 0; k < 12; ++k) {
    CameraPose pose;
    pose.R_world_cam = exp_so3({0, 0.015 * k, 0});
    const int before = static_cast<int>(frame.features.size());
    frame = tracker.track(k * kFramePeriod, scene.image(pose), Eigen::Matrix3d::Identity());
    if (k == 0) continue;
    kept += count_longer_than(frame, 1);
    asked += before;
  }
  EXPECT_GT(kept, asked * 9 / 10);
}

TEST(Tracker, PureRotationRejectsNoTrack) {
  Flight flight;
  int rejected = 0, seen = 0;
  for (int k = 0; k < 20; ++k) {
    CameraPose pose;
    pose.R_world_cam = exp_so3({0.02 * std::sin(0.5 * k), 0.004 * k, 0.003 * k});
    const TrackedFrame frame = flight.step(pose);
    rejected += frame.rejected;
    seen += static_cast<int>(frame.features.size());
  }
  EXPECT_LE(rejected, seen / 200);
}

TEST(Tracker, EndsTracksOnAThingThatMovesByItself) {
  Flight flight;
  const cv::Mat intruder = testing_view::random_texture(128, 99);
  int on_intruder = 0;
  for (int k = 0; k < 30; ++k) {
    const CameraPose pose = swaying_pose(frame_time(k));
    cv::Mat image = flight.scene.image(pose, 1.5, k + 1);
    const cv::Rect place(90 + 2 * k, 150 - 3 * k, 60, 60);
    cv::Mat shades;
    intruder(cv::Rect(0, 0, 60, 60)).convertTo(shades, CV_8U);
    shades.copyTo(image(place));
    const TrackedFrame frame = flight.step(pose, image);
    if (k < 15) continue;
    for (const TrackedFeature& feature : frame.features) {
      const cv::Rect inner(place.x + 5, place.y + 5, 50, 50);
      const cv::Point pixel(static_cast<int>(feature.pixel.x()),
                            static_cast<int>(feature.pixel.y()));
      on_intruder += inner.contains(pixel) && feature.length > 10 ? 1 : 0;
    }
  }
  EXPECT_LE(on_intruder, 2);
}

// The drone's own legs: what lies behind them comes out again, they never move.
TEST(Tracker, TracksNothingWhereItsMaskIsBlack) {
  const cv::Rect leg(120, 0, 60, 240);
  cv::Mat mask(240, 320, CV_8UC1, cv::Scalar(255));
  mask(leg).setTo(0);
  cv::Mat texture;
  testing_view::random_texture(384, 99)(cv::Rect(0, 0, 60, 240)).convertTo(texture, CV_8U);
  Flight flight(small_config(), mask);
  std::size_t fewest = 1000;
  for (int k = 0; k < 30; ++k) {
    const CameraPose pose = swaying_pose(frame_time(k));
    cv::Mat image = flight.scene.image(pose, 1.5, k + 1);
    texture.copyTo(image(leg));
    const TrackedFrame frame = flight.step(pose, image);
    fewest = std::min(fewest, frame.features.size());
    for (const TrackedFeature& feature : frame.features) {
      const double x = feature.pixel.x();
      EXPECT_TRUE(x < leg.x - 3 || x > leg.x + leg.width + 3) << "image " << k << ", column " << x;
    }
  }
  EXPECT_GE(fewest, 50U);
}

TEST(Tracker, NeverUsesAnIdAgain) {
  Flight flight;
  std::set<std::uint64_t> ended, alive;
  const cv::Mat black(240, 320, CV_8U, cv::Scalar(0));
  for (int k = 0; k < 30; ++k) {
    const CameraPose pose = swaying_pose(3 * frame_time(k));
    const TrackedFrame frame = k % 10 == 9 ? flight.step(pose, black) : flight.step(pose);
    std::set<std::uint64_t> now;
    for (const TrackedFeature& feature : frame.features) {
      EXPECT_TRUE(now.insert(feature.track_id).second);
      EXPECT_EQ(ended.count(feature.track_id), 0u);
      EXPECT_EQ(feature.length == 1, alive.count(feature.track_id) == 0);
    }
    for (const std::uint64_t id : alive) {
      if (now.count(id) == 0) ended.insert(id);
    }
    alive = now;
  }
  EXPECT_GT(ended.size(), 100u);
}

TEST(Tracker, CountsWhatHappenedToEachTrack) {
  Flight flight;
  int before = 0;
  for (int k = 0; k < 20; ++k) {
    const TrackedFrame frame = flight.step(swaying_pose(3 * frame_time(k)));
    EXPECT_EQ(static_cast<int>(frame.features.size()),
              before - frame.lost - frame.rejected + frame.added);
    before = static_cast<int>(frame.features.size());
    EXPECT_LE(before, small_config().max_tracks);
  }
}

TEST(Tracker, SpreadsTracksOverTheWholeImage) {
  Flight flight;
  TrackedFrame frame;
  for (int k = 0; k < 20; ++k) frame = flight.step(swaying_pose(frame_time(k)));
  EXPECT_GE(frame.features.size(), 72u);
  std::set<int> occupied;  // of 5 x 4 fields
  for (const TrackedFeature& feature : frame.features) {
    occupied.insert(static_cast<int>(feature.pixel.y() / 60) * 5 +
                    static_cast<int>(feature.pixel.x() / 64));
  }
  EXPECT_EQ(occupied.size(), 20u);
}

TEST(Tracker, NoTwoTracksShareAPlace) {
  Flight flight;
  for (int k = 0; k < 30; ++k) {
    const TrackedFrame frame = flight.step(swaying_pose(2 * frame_time(k)));
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        EXPECT_GT((frame.features[i].pixel - frame.features[j].pixel).norm(), 6.0);
      }
    }
  }
}

TEST(Tracker, AConstantImageHasNoTracksAndDoesNotCrash) {
  Tracker tracker(small_config(), small_camera());
  for (const int grey : {0, 128, 255}) {
    const cv::Mat image(240, 320, CV_8U, cv::Scalar(grey));
    TrackedFrame frame = tracker.track(grey * kFramePeriod, image, Eigen::Matrix3d::Identity());
    EXPECT_TRUE(frame.features.empty());
    tracker.describe(frame);
  }
}

TEST(Tracker, StartsAgainAfterTheImageWentDark) {
  Flight flight;
  flight.step(CameraPose());
  const TrackedFrame dark = flight.step(CameraPose(), cv::Mat(240, 320, CV_8U, cv::Scalar(0)));
  EXPECT_TRUE(dark.features.empty());
  EXPECT_GT(dark.lost, 0);
  EXPECT_GT(flight.step(CameraPose()).features.size(), 60u);
}

TEST(Tracker, SurvivesAJumpOfGainAndExposure) {
  Flight flight;
  TrackedFrame frame;
  for (int k = 0; k < 10; ++k) frame = flight.step(swaying_pose(frame_time(k)));
  const int before = static_cast<int>(frame.features.size());
  const CameraPose pose = swaying_pose(frame_time(10));
  cv::Mat brighter;
  flight.scene.image(pose).convertTo(brighter, CV_8U, 0.7, 60);
  frame = flight.step(pose, brighter);
  EXPECT_GE(count_longer_than(frame, 1), before * 9 / 10);
  EXPECT_LT(quantile(flight.errors(pose, frame, 2), 0.5), 0.12);
}

TEST(Tracker, WorksOnImagesOfLittleContrast) {
  Flight flight;
  TrackedFrame frame;
  CameraPose pose;
  for (int k = 0; k < 20; ++k) {
    pose = swaying_pose(frame_time(k));
    cv::Mat flat;
    flight.scene.image(pose, 0.0).convertTo(flat, CV_8U, 0.12, 100);
    frame = flight.step(pose, flat);
  }
  EXPECT_GE(count_longer_than(frame, 15), 30);
  EXPECT_LT(quantile(flight.errors(pose, frame, 15), 0.5), 0.3);
}

TEST(Tracker, GivesTheSameTracksTwiceInARow) {
  Flight first, second;
  for (int k = 0; k < 15; ++k) {
    const CameraPose pose = swaying_pose(2 * frame_time(k));
    const cv::Mat image = first.scene.image(pose);
    const TrackedFrame a = first.step(pose, image);
    const TrackedFrame b = second.step(pose, image);
    ASSERT_EQ(a.features.size(), b.features.size());
    for (std::size_t i = 0; i < a.features.size(); ++i) {
      EXPECT_EQ(a.features[i].track_id, b.features[i].track_id);
      EXPECT_EQ(a.features[i].pixel, b.features[i].pixel);
    }
  }
}

TEST(Tracker, TakesACopyOfTheImage) {
  Flight first, second;
  cv::Mat buffer;
  for (int k = 0; k < 5; ++k) {
    const CameraPose pose = swaying_pose(frame_time(k));
    const cv::Mat image = first.scene.image(pose);
    const TrackedFrame a = first.step(pose, image);
    image.copyTo(buffer);
    const TrackedFrame b = second.step(pose, buffer);
    buffer.setTo(0);
    ASSERT_EQ(a.features.size(), b.features.size());
    EXPECT_EQ(a.features.back().pixel, b.features.back().pixel);
  }
}

TEST(Tracker, RefusesImagesOfAnotherSizeOrType) {
  Tracker tracker(small_config(), small_camera());
  const auto message = [&](const cv::Mat& image) -> std::string {
    try {
      tracker.track(0, image, Eigen::Matrix3d::Identity());
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message(cv::Mat(200, 320, CV_8U, cv::Scalar(0))).find("320x200"), std::string::npos);
  EXPECT_NE(message(cv::Mat(240, 320, CV_16U, cv::Scalar(0))).find("8-bit"), std::string::npos);
  EXPECT_NE(message(cv::Mat()).find("0x0"), std::string::npos);
}

TEST(Tracker, RefusesASettingThatCannotWork) {
  TrackerConfig none = small_config();
  none.max_tracks = 0;
  EXPECT_THROW(Tracker(none, small_camera()), std::runtime_error);
  TrackerConfig far_back = small_config();
  far_back.outliers.max_lag = 100;
  EXPECT_THROW(Tracker(far_back, small_camera()), std::runtime_error);
  EXPECT_THROW(Tracker(small_config(), CameraIntrinsics()), std::runtime_error);
  const cv::Mat other_size(240, 100, CV_8UC1, cv::Scalar(255));
  EXPECT_THROW(Tracker(small_config(), small_camera(), other_size), std::runtime_error);
}

TEST(Tracker, CovarianceOfABearingIsThatOfThePixelThroughTheLens) {
  Flight flight;
  const TrackedFrame frame = flight.step(CameraPose());
  const CameraMeasurement measurement = to_measurement(frame);
  ASSERT_EQ(measurement.tracks.size(), frame.features.size());
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const TrackedFeature& feature = frame.features[i];
    Eigen::Matrix2d J;
    EXPECT_LT((project(small_camera(), feature.bearing, &J) - feature.pixel).norm(), 1e-6);
    const double variance = small_config().pixel_sigma * small_config().pixel_sigma;
    const Eigen::Matrix2d of_pixel = J * feature.covariance * J.transpose();
    EXPECT_LT((of_pixel - variance * Eigen::Matrix2d::Identity()).norm(), 1e-9);
    EXPECT_EQ(measurement.tracks[i].track_id, feature.track_id);
    EXPECT_EQ(measurement.tracks[i].bearing, feature.bearing);
    EXPECT_EQ(measurement.tracks[i].covariance, feature.covariance);
  }
}

TEST(Tracker, WhatIsFollowedIsAsCertainAsItsAlignmentClaims) {
  Flight flight;
  flight.step(CameraPose());
  const TrackedFrame frame = flight.step(CameraPose());
  const TrackerConfig config = small_config();
  int followed = 0;
  for (const TrackedFeature& feature : frame.features) {
    if (feature.length < 2) continue;
    Eigen::Matrix2d J;
    EXPECT_LT((project(small_camera(), feature.bearing, &J) - feature.pixel).norm(), 1e-6);
    const Eigen::Matrix2d of_pixel = J * feature.covariance * J.transpose();
    const Eigen::Vector2d variances =
        of_pixel.selfadjointView<Eigen::Lower>().eigenvalues().cwiseMax(0);
    EXPECT_GE(std::sqrt(variances(0)), config.aligned_sigma * (1 - 1e-9));
    EXPECT_LT(std::sqrt(variances(1)), config.pixel_sigma) << "the image has not changed";
    ++followed;
  }
  EXPECT_GT(followed, 10);
}

int hamming(const BinaryDescriptor& a, const BinaryDescriptor& b) {
  int bits = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    bits += __builtin_popcount(static_cast<unsigned>(a[i] ^ b[i]));
  }
  return bits;
}

TEST(Tracker, DescribesATrackAlikeInEveryImage) {
  Flight flight;
  TrackedFrame first = flight.step(swaying_pose(0));
  flight.tracker.describe(first);
  TrackedFrame last;
  for (int k = 1; k < 15; ++k) last = flight.step(swaying_pose(frame_time(k)));
  flight.tracker.describe(last);
  std::map<std::uint64_t, BinaryDescriptor> descriptors;
  for (const TrackedFeature& feature : first.features) {
    if (feature.described) descriptors[feature.track_id] = feature.descriptor;
  }
  std::vector<double> same, different;
  for (const TrackedFeature& feature : last.features) {
    for (const auto& [id, descriptor] : descriptors) {
      if (!feature.described) continue;
      (id == feature.track_id ? same : different)
          .push_back(hamming(feature.descriptor, descriptor));
    }
  }
  ASSERT_GE(same.size(), 20u);
  EXPECT_LT(quantile(same, 0.8), 50);
  EXPECT_GT(quantile(different, 0.05), 70);
}

TEST(Tracker, DescribesOnlyTracksAwayFromTheEdge) {
  Flight flight;
  TrackedFrame frame = flight.step(CameraPose());
  flight.tracker.describe(frame);
  int described = 0;
  for (const TrackedFeature& feature : frame.features) {
    const double x = feature.pixel.x(), y = feature.pixel.y();
    const double to_edge = std::min({x, y, 319 - x, 239 - y});
    if (to_edge < 22 || to_edge > 24) {
      EXPECT_EQ(feature.described, to_edge > 24) << feature.pixel.transpose();
    }
    described += feature.described ? 1 : 0;
  }
  EXPECT_GT(described, 30);
}

}  // namespace
}  // namespace covey
