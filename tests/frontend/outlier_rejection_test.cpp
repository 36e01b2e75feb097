// SPDX-License-Identifier: Apache-2.0
#include "frontend/outlier_rejection.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <random>

#include "estimator/so3.h"

namespace covey {
namespace {

constexpr double kFocal = 450;  // px

struct Scene {
  std::vector<BearingPair> pairs;
  std::vector<bool> wrong;
};

struct Motion {
  Eigen::Matrix3d R_now_before = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_now_before = Eigen::Vector3d::Zero();  // m
};

// Points 2..8 m away; one in `every` is moved by 4..20 px in a random direction.
Scene make_scene(const Motion& motion, int every, double noise_px = 0.2, unsigned seed = 5) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> noise(0, noise_px / kFocal);
  Scene scene;
  for (int i = 0; i < 200; ++i) {
    BearingPair pair;
    pair.before = {0.7 * uniform(random), 0.5 * uniform(random)};
    const double depth = 5 + 3 * uniform(random);
    const Eigen::Vector3d p =
        motion.R_now_before * (depth * pair.before.homogeneous()) + motion.p_now_before;
    pair.now = p.hnormalized() + Eigen::Vector2d(noise(random), noise(random));
    const bool wrong = every > 0 && i % every == 0;
    if (wrong) {
      const double angle = M_PI * uniform(random);
      const double size = (12 + 8 * uniform(random)) / kFocal;
      pair.now += size * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    }
    scene.pairs.push_back(pair);
    scene.wrong.push_back(wrong);
  }
  return scene;
}

TwoViews views(const Eigen::Matrix3d& R_now_before, double rotation_sigma = 1e-3) {
  TwoViews views;
  views.R_now_before = R_now_before;
  views.rotation_sigma = rotation_sigma;
  views.focal_px = kFocal;
  return views;
}

struct Verdict {
  int kept_right = 0, kept_wrong = 0, right = 0, wrong = 0;
};

Verdict judge(const Scene& scene, const TwoViews& two_views) {
  const std::vector<bool> inliers = rigid_scene_inliers(scene.pairs, two_views, OutlierConfig());
  Verdict verdict;
  for (std::size_t i = 0; i < inliers.size(); ++i) {
    ++(scene.wrong[i] ? verdict.wrong : verdict.right);
    if (inliers[i]) ++(scene.wrong[i] ? verdict.kept_wrong : verdict.kept_right);
  }
  return verdict;
}

TEST(OutlierRejection, FindsTheWrongTracksOfAMovingCamera) {
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0.2, 0, 0), Eigen::Vector3d(0.1, -0.15, 0.1),
                                   Eigen::Vector3d(0.02, 0.01, -0.4)}) {
    const Motion motion{exp_so3({0.05, -0.1, 0.08}), p};
    const Verdict verdict = judge(make_scene(motion, 5), views(motion.R_now_before));
    EXPECT_GE(verdict.kept_right, verdict.right * 98 / 100) << p.transpose();
    // One that was moved along its epipolar line in the right sense cannot be told.
    EXPECT_LE(verdict.kept_wrong, verdict.wrong / 5) << p.transpose();
  }
}

TEST(OutlierRejection, PureRotationKeepsAllRightTracks) {
  const Motion motion{exp_so3({0.05, -0.1, 0.08}), Eigen::Vector3d::Zero()};
  const Verdict verdict = judge(make_scene(motion, 10), views(motion.R_now_before));
  EXPECT_GE(verdict.kept_right, verdict.right * 98 / 100);
  EXPECT_LE(verdict.kept_wrong, verdict.wrong / 4);
}

TEST(OutlierRejection, AGyroBiasNobodyKnowsYetCostsNoTrack) {
  // 0.08 rad/s over a quarter of a second: 9 px.
  const Motion motion{exp_so3({0.05, -0.1, 0.08}), Eigen::Vector3d(0.15, 0.05, 0.1)};
  const Eigen::Matrix3d R_biased = exp_so3({0.006, -0.012, 0.014}) * motion.R_now_before;
  const Verdict verdict = judge(make_scene(motion, 10), views(R_biased, 0.025));
  EXPECT_GE(verdict.kept_right, verdict.right * 95 / 100);
  EXPECT_LE(verdict.kept_wrong, verdict.wrong / 3);
}

TEST(OutlierRejection, RejectsPointsThatWouldLieBehindTheCamera) {
  const Motion motion{Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.3, 0, 0)};
  Scene scene = make_scene(motion, 0, 0.05);
  for (std::size_t i = 0; i < scene.pairs.size(); i += 10) {
    BearingPair& pair = scene.pairs[i];
    pair.now = pair.before - (pair.now - pair.before);  // same line, the other way
    scene.wrong[i] = true;
  }
  const Verdict verdict = judge(scene, views(motion.R_now_before));
  EXPECT_EQ(verdict.kept_right, verdict.right);
  EXPECT_EQ(verdict.kept_wrong, 0);
}

TEST(OutlierRejection, WithoutAConsensusNothingIsRejected) {
  const Motion motion{Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.3, 0, 0)};
  const Scene scene = make_scene(motion, 1);
  const Verdict verdict = judge(scene, views(motion.R_now_before));
  EXPECT_EQ(verdict.kept_wrong, verdict.wrong);
}

TEST(OutlierRejection, FewTracksOrNoneAreLeftAlone) {
  const Motion motion{Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.3, 0, 0)};
  Scene scene = make_scene(motion, 2);
  for (const std::size_t count : {std::size_t{9}, std::size_t{1}, std::size_t{0}}) {
    scene.pairs.resize(count);
    const auto inliers = rigid_scene_inliers(scene.pairs, views(motion.R_now_before), {});
    EXPECT_EQ(inliers, std::vector<bool>(count, true));
  }
}

TEST(OutlierRejection, TracksThatDoNotMoveAtAllAreKept) {
  std::vector<BearingPair> pairs(50);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    pairs[i].before = pairs[i].now = Eigen::Vector2d(0.01 * static_cast<double>(i), 0.1);
  }
  const auto inliers = rigid_scene_inliers(pairs, views(Eigen::Matrix3d::Identity()), {});
  EXPECT_EQ(std::count(inliers.begin(), inliers.end(), true), 50);
}

}  // namespace
}  // namespace covey
