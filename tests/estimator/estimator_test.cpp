// SPDX-License-Identifier: Apache-2.0
//
// What the filter does when its input is not as it should be.
#include "estimator/estimator.h"

#include <gtest/gtest.h>

#include <vector>

namespace covey {
namespace {

constexpr double kImuRate_hz = 200;

// A drone that stands still, level.
ImuSample still_sample(double time_s) {
  return {nanoseconds(time_s), Eigen::Vector3d::Zero(), {0, 0, EstimatorConfig().gravity}};
}

void add_still_imu(Estimator& estimator, double from_s, double to_s) {
  const int samples = static_cast<int>((to_s - from_s) * kImuRate_hz);
  for (int i = 0; i <= samples; ++i) estimator.add_imu(still_sample(from_s + i / kImuRate_hz));
}

InitialState start_at(double time_s) {
  InitialState start;
  start.stamp_ns = nanoseconds(time_s);
  return start;
}

CameraMeasurement image_at(double time_s) { return {nanoseconds(time_s), {}}; }

TEST(Estimator, ImuFromBeforeTheStartIsKeptForSecondsOnly) {
  const auto gaps_from = [](double start_s) {
    Estimator estimator(EstimatorConfig{});
    add_still_imu(estimator, 0, 60);
    estimator.initialize(start_at(start_s));
    return estimator.add_camera(image_at(60)).imu_gaps;
  };
  EXPECT_EQ(gaps_from(55), 0);
  EXPECT_EQ(gaps_from(20), 1) << "what would fill it is no longer there";
}

TEST(Estimator, ImuFromBeforeImagesThatShowNothingIsForgotten) {
  Estimator estimator(EstimatorConfig{});
  estimator.initialize(start_at(0));
  add_still_imu(estimator, 0, 60);
  for (int i = 1; i < 50; ++i) EXPECT_EQ(estimator.pass_image(nanoseconds(i)).imu_gaps, 0);
  estimator.initialize(start_at(1));
  EXPECT_EQ(estimator.add_camera(image_at(50)).imu_gaps, 1)
      << "what would fill it is no longer there";
}

TEST(Estimator, WithoutImuItDoesNotClaimToTrack) {
  Estimator estimator(EstimatorConfig{});
  estimator.initialize(start_at(0));
  add_still_imu(estimator, 0, 1);
  UpdateReport last;
  for (int i = 1; i <= 30; ++i) last = estimator.add_camera(image_at(1 + i / 30.0));
  EXPECT_FALSE(last.propagated);
  EXPECT_EQ(estimator.odometry().status, FilterStatus::kDegraded);
}

TEST(Estimator, AnImageThatIsRefusedIsNoImuSampleOutOfOrder) {
  Estimator estimator(EstimatorConfig{});
  estimator.initialize(start_at(0));
  add_still_imu(estimator, 0, 1);
  const UpdateReport refused = estimator.add_camera(image_at(2));
  EXPECT_EQ(refused.images_refused, 1);
  EXPECT_EQ(refused.out_of_order, 1);
  estimator.add_imu(still_sample(0.5));
  const UpdateReport taken = estimator.add_camera(image_at(0.9));
  EXPECT_EQ(taken.images_refused, 0);
  EXPECT_EQ(taken.out_of_order, 1);
}

}  // namespace
}  // namespace covey
