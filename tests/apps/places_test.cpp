// SPDX-License-Identifier: Apache-2.0
//
// `covey places`: who has seen the same place, and how well descriptors tell.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "apps/bag_of_words.h"
#include "apps/json_file.h"
#include "apps/place_comparison.h"
#include "apps/place_report.h"
#include "frontend/vocabulary_visual.h"
#include "tests/apps/temporary_folder.h"
#include "tests/frontend/euroc_camera.h"
#include "tests/frontend/synthetic_places.h"

namespace covey {
namespace {

using testing::level_camera;

TEST(PrecisionRecall, OfFivePairsIsWhatOneCountsByHand) {
  const PrecisionRecall result =
      precision_recall({{0.9, true}, {0.1, false}, {0.8, false}, {0.7, true}, {0.7, true}});
  ASSERT_EQ(result.curve.size(), 4u) << "two that score alike are one point";
  EXPECT_DOUBLE_EQ(result.curve[2].precision, 3.0 / 4);
  EXPECT_DOUBLE_EQ(result.curve[2].recall, 1);
  EXPECT_DOUBLE_EQ(result.recall_at_full_precision, 1.0 / 3);
  EXPECT_DOUBLE_EQ(result.average_precision, 1.0 / 3 + 2.0 / 3 * 3 / 4);
}

TEST(PrecisionRecall, WithoutAnySamePlaceIsNothing) {
  EXPECT_TRUE(precision_recall({{0.9, false}}).curve.empty());
  EXPECT_TRUE(precision_recall({}).curve.empty());
}

// A wall at x = 0, seen from in front of it.
SurveyedView view_of_wall(const Eigen::Vector3d& p_world_cam, double yaw = 0) {
  SurveyedView view;
  view.camera = testing::euroc_camera();
  view.T_world_cam = level_camera(p_world_cam, yaw);
  for (int y = -4; y <= 4; ++y) {
    for (int z = -1; z <= 1; ++z) {
      view.points_world.push_back({0, p_world_cam.y() + y, p_world_cam.z() + z});
    }
  }
  return view;
}

TEST(ViewOverlap, IsWholeForOneViewAndShrinksWithTheWayBetweenTwo) {
  const SurveyedView here = view_of_wall({-5, 0, 0});
  EXPECT_EQ(view_overlap(here, here), 1);
  const double near = view_overlap(here, view_of_wall({-5, 1, 0}));
  const double farther = view_overlap(here, view_of_wall({-5, 2.5, 0}));
  EXPECT_GT(near, farther);
  EXPECT_GT(farther, 0);
  EXPECT_EQ(view_overlap(here, view_of_wall({-5, 12, 0})), 0);
  EXPECT_EQ(view_overlap(here, view_of_wall({-5, 1, 0})),
            view_overlap(view_of_wall({-5, 1, 0}), here));
}

TEST(ViewOverlap, EndsWhereDescriptorsDo) {
  const SurveyedView here = view_of_wall({-5, 0, 0});
  EXPECT_GT(view_overlap(here, view_of_wall({-7, 0, 0})), 0.9);
  EXPECT_EQ(view_overlap(here, view_of_wall({-15, 0, 0})), 0) << "three times as far";
  EXPECT_EQ(view_overlap(here, view_of_wall({-5, 0, 0}, 3.14)), 0) << "looks away";
  EXPECT_EQ(view_overlap(here, view_of_wall({5, 0, 0}, 3.14)), 0) << "from behind";
}

TEST(BagOfWords, RareWordsCountMoreAndCommonOnesNothing) {
  const std::vector<WordCounts> places = {{{0, 3}, {1, 1}}, {{0, 3}, {1, 1}}, {{0, 3}, {2, 1}}};
  const BagOfWords bag(3, places);
  EXPECT_NEAR(bag.score(places[0], places[1]), 1, 1e-12);
  EXPECT_EQ(bag.score(places[0], places[2]), 0) << "word 0 is in every place";
  EXPECT_EQ(bag.score(places[0], {}), 0);
}

// Two drones pass four walls, far from each other; the second one's descriptors have other bits
// here and there.
std::vector<SurveyedView> two_flights() {
  std::mt19937 random(5);
  std::vector<SurveyedView> views;
  for (int wall = 0; wall < 4; ++wall) {
    SurveyedView first = view_of_wall({-5, 100.0 * wall, 0});
    first.drone = "uav0";
    for (int i = 0; i < 80; ++i) first.features.push_back(testing::random_descriptor(random));
    SurveyedView second = first;
    second.drone = "uav1";
    for (BinaryDescriptor& feature : second.features) {
      feature = testing::with_noise(feature, 15, random);
    }
    views.push_back(std::move(first));
    views.push_back(std::move(second));
  }
  return views;
}

ComparisonConfig with_bag() {
  ComparisonConfig config;
  config.vocabulary = visual_vocabulary();
  config.many_words = visual_vocabulary();
  return config;
}

TEST(CompareDescriptors, FindsDistinctPlacesAgain) {
  const DatasetComparison result = compare_descriptors("walls", two_flights(), with_bag());
  EXPECT_EQ(result.views, 8u);
  EXPECT_EQ(result.same, 4u);
  EXPECT_EQ(result.different, 12u);
  ASSERT_EQ(result.descriptors.size(), 4u);
  for (const DescriptorResult& descriptor : result.descriptors) {
    EXPECT_GT(descriptor.mean_bytes, 0) << descriptor.name;
    EXPECT_GE(descriptor.figures.average_precision, 0.25) << descriptor.name;
  }
  const DescriptorResult& compact = result.descriptors.back();
  EXPECT_EQ(compact.name, "compact");
  EXPECT_EQ(compact.mean_bytes, 80 * 8);
  EXPECT_EQ(compact.figures.average_precision, 1);
  EXPECT_EQ(compact.first_is_right, 1);
}

TEST(CompareDescriptors, RefusesFlightsThatNeverMeet) {
  std::vector<SurveyedView> views = two_flights();
  for (SurveyedView& view : views) view.drone = "uav0";
  EXPECT_THROW((void)compare_descriptors("walls", views, with_bag()), std::runtime_error);
}

TEST(PlaceReport, HoldsAllFigures) {
  const TemporaryFolder folder;
  const std::filesystem::path out = folder.path();
  write_place_report(out, {compare_descriptors("walls", two_flights(), with_bag())});
  const nlohmann::json json = read_json_file(out / "places.json");
  EXPECT_EQ(json["walls"]["pairs_same_place"], 4);
  EXPECT_EQ(json["walls"]["descriptors"]["compact"]["average_precision"], 1);
  EXPECT_TRUE(std::filesystem::exists(out / "curves.csv"));
  EXPECT_TRUE(std::filesystem::exists(out / "places.svg"));
}

}  // namespace
}  // namespace covey
