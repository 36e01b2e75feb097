// SPDX-License-Identifier: Apache-2.0
#include "frontend/landmark_patch.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <cstdint>

#include "sim/random.h"

namespace covey {
namespace {

constexpr double kDepth = 8;  // m, of the wall
constexpr double kSky = 100;  // m, farther away nothing is seen of a wall that is turned
constexpr double kSpacing = 1.25 / 455;

CameraIntrinsics camera() {
  CameraIntrinsics camera;
  camera.width = 752;
  camera.height = 480;
  camera.fx = camera.fy = 455;
  camera.cx = 375.5;
  camera.cy = 239.5;
  camera.distortion = {-0.2, 0.05, 1e-4, -1e-4};
  return camera;
}

double lattice(int x, int y) {
  const std::uint32_t mixed = 2654435761U * static_cast<std::uint32_t>(x + 1013 * y);
  return (mixed ^ (mixed >> 15U)) % 200 + 20.0;
}

// Smooth noise, a grain of 4 pixels.
double wall(double x, double y) {
  constexpr double kGrain = 0.07;  // m
  const double u = x / kGrain, v = y / kGrain;
  const int i = static_cast<int>(std::floor(u)), k = static_cast<int>(std::floor(v));
  const auto smooth = [](double t) { return t * t * (3 - 2 * t); };
  const double a = smooth(u - i), b = smooth(v - k);
  return (1 - b) * ((1 - a) * lattice(i, k) + a * lattice(i + 1, k)) +
         b * ((1 - a) * lattice(i, k + 1) + a * lattice(i + 1, k + 1));
}

// How a wall looks from the own camera. It stands kDepth before the other one, at right angles to
// where that looks unless it is turned.
struct Look {
  double gain = 1, offset = 0;
  double stretch = 1;                                          // of the texture, upwards
  double noise = 0;                                            // grey levels
  Eigen::Matrix3d R_other_wall = Eigen::Matrix3d::Identity();  // z: its normal
};

ImagePyramid see_wall(const Eigen::Isometry3d& T_other_own, const Look& look = {}) {
  Random random(3, 0x9a7c);
  const CameraIntrinsics cam = camera();
  cv::Mat image(cam.height, cam.width, CV_8UC1);
  Eigen::Isometry3d T_wall_other = Eigen::Isometry3d::Identity();
  T_wall_other.linear() = look.R_other_wall.transpose();
  T_wall_other.translation() = -(T_wall_other.linear() * Eigen::Vector3d(0, 0, kDepth));
  const Eigen::Isometry3d T_wall_own = T_wall_other * T_other_own;
  for (int v = 0; v < cam.height; ++v) {
    for (int u = 0; u < cam.width; ++u) {
      const auto bearing = unproject(cam, {u, v});
      double grey = 0;
      if (bearing) {
        const Eigen::Vector3d ray = T_wall_own.linear() * bearing->homogeneous();
        const double along = -T_wall_own.translation().z() / ray.z();
        const Eigen::Vector3d p = T_wall_own.translation() + along * ray;
        if (along > 0 && along < kSky) {
          grey = look.gain * wall(p.x(), p.y() / look.stretch) + look.offset;
        }
        if (look.noise > 0) grey += look.noise * random.gaussian();
      }
      image.at<std::uint8_t>(v, u) = cv::saturate_cast<std::uint8_t>(grey);
    }
  }
  return build_pyramid(image, 3);
}

Eigen::Isometry3d own_pose() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(0.1, Eigen::Vector3d(0.3, 1, 0.2).normalized()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(0.8, 0.1, 1.0);
  return T;
}

struct Search {
  int tried = 0, found = 0;
  int near = 0;  // of those found: so near to the truth
};

// What is looked for in the own image, and what is believed of it.
struct Question {
  Eigen::Isometry3d T_other_own = own_pose();       // in truth
  Eigen::Vector3d error = Eigen::Vector3d::Zero();  // m, of where that is believed to be
  Look look;                                        // of the other's image
  Eigen::Vector3d up = -Eigen::Vector3d::UnitY();   // in the other camera
  double near_px = 0.2;
};

// Looks for patches of the other's image in the own one.
Search search(const ImagePyramid& own, const Question& question) {
  const ImagePyramid other = see_wall(Eigen::Isometry3d::Identity(), question.look);
  const Eigen::Vector3d normal = question.look.R_other_wall.col(2);
  Eigen::Isometry3d assumed = question.T_other_own;
  assumed.translation() += question.error;
  Search result;
  for (double x = -0.3; x <= 0.3; x += 0.1) {
    for (double y = -0.2; y <= 0.2; y += 0.1) {
      const Eigen::Vector3d b(x, y, 1);
      const auto patch = cut_landmark_patch(other.levels[0], camera(), {x, y}, kSpacing);
      if (!patch) continue;
      ++result.tried;
      const double depth = kDepth * normal.z() / normal.dot(b);
      const SeenLandmark seen{{x, y}, 1 / depth, &*patch, kSpacing, question.up};
      const auto found = find_landmark_patch(own, camera(), seen, assumed, {});
      if (!found) continue;
      ++result.found;
      const Eigen::Vector3d p_own = question.T_other_own.inverse() * (depth * b).eval();
      const Eigen::Vector2d truth = project(camera(), p_own.hnormalized());
      result.near += (project(camera(), found->bearing) - truth).norm() < question.near_px ? 1 : 0;
    }
  }
  return result;
}

Search search(const ImagePyramid& own, const Eigen::Vector3d& error) {
  Question question;
  question.error = error;
  return search(own, question);
}

TEST(LandmarkPatch, IsFoundToAFifthOfAPixelFromAnotherPlace) {
  const Search result =
      search(see_wall(own_pose()), Eigen::Vector3d(0.03, -0.02, 0.0));  // about 2 px
  EXPECT_GE(result.tried, 30);
  EXPECT_GE(result.found, result.tried * 2 / 3);
  EXPECT_GE(result.near, result.found * 8 / 10);
}

// Eight octets say where a corner is to a twelfth of a pixel, whatever they leave out.
TEST(LandmarkPatch, IsFoundWhereItWasCut) {
  Question question;
  question.T_other_own = Eigen::Isometry3d::Identity();
  question.error = Eigen::Vector3d(0.02, -0.01, 0);  // about 1 px
  question.near_px = 0.08;
  const Search result = search(see_wall(question.T_other_own), question);
  EXPECT_GE(result.tried, 30);
  EXPECT_EQ(result.found, result.tried);
  EXPECT_GE(result.near, result.found * 9 / 10);
}

TEST(LandmarkPatch, BrightnessDoesNotMatter) {
  const Search result = search(see_wall(own_pose(), {0.6, 50}), Eigen::Vector3d::Zero());
  EXPECT_GE(result.found, result.tried * 2 / 3);
  EXPECT_GE(result.near, result.found * 8 / 10);
}

// The texture changes slowly upwards: there a patch is found less well, and says so.
TEST(LandmarkPatch, SaysHowWellItIsFound) {
  const Look look{0.4, 0, 3, 2};
  const ImagePyramid other = see_wall(Eigen::Isometry3d::Identity(), look);
  const ImagePyramid own = see_wall(own_pose(), look);
  Eigen::Vector2d squared = Eigen::Vector2d::Zero(), claimed = Eigen::Vector2d::Zero();
  double nees = 0;
  int found = 0;
  for (double x = -0.3; x <= 0.3; x += 0.05) {
    for (double y = -0.2; y <= 0.2; y += 0.05) {
      const auto patch = cut_landmark_patch(other.levels[0], camera(), {x, y}, kSpacing);
      if (!patch) continue;
      const auto one = find_landmark_patch(own, camera(), {{x, y}, 1 / kDepth, &*patch, kSpacing},
                                           own_pose(), {});
      if (!one) continue;
      const Eigen::Vector3d p(kDepth * x, kDepth * y, kDepth);
      const Eigen::Vector2d error = one->bearing - (own_pose().inverse() * p).hnormalized();
      squared += error.cwiseAbs2();
      claimed += one->covariance.diagonal();
      nees += error.dot(one->covariance.inverse() * error);
      ++found;
    }
  }
  ASSERT_GE(found, 30);
  EXPECT_GT(squared.y(), 2 * squared.x());
  EXPECT_GT(claimed.y(), 2 * claimed.x());
  EXPECT_GT(nees / found, 1.0);
  EXPECT_LT(nees / found, 2 * 3.0) << "errors of much more than what is claimed";
}

// From two metres aside, of a wall that is turned: what its surface is makes a difference.
Search search_turned(const Eigen::Matrix3d& R_other_wall, const Eigen::Vector3d& up) {
  Question question;
  question.T_other_own.translation() = Eigen::Vector3d(2.0, -1.0, 0.5);
  question.look.R_other_wall = R_other_wall;
  question.up = up;
  question.near_px = 0.3;
  return search(see_wall(question.T_other_own, question.look), question);
}

TEST(LandmarkPatch, IsFoundOnTheGround) {
  const Eigen::Vector3d up = Eigen::Vector3d(0, -0.75, -0.66).normalized();  // looks down
  Eigen::Matrix3d R_other_ground;
  R_other_ground << Eigen::Vector3d::UnitX(), up.cross(Eigen::Vector3d::UnitX()), up;
  const Search result = search_turned(R_other_ground, up);
  EXPECT_GE(result.tried, 30);
  EXPECT_GE(result.found, result.tried * 2 / 3);
  EXPECT_GE(result.near, result.found * 8 / 10);
}

TEST(LandmarkPatch, IsFoundOnAWallThatIsSeenFromAside) {
  const Eigen::Vector3d up = -Eigen::Vector3d::UnitY();
  for (const double turn : {-0.8, 0.8}) {
    const Search result = search_turned(Eigen::AngleAxisd(turn, up).toRotationMatrix(), up);
    EXPECT_GE(result.tried, 30);
    EXPECT_GE(result.found, result.tried * 2 / 3) << turn;
    EXPECT_GE(result.near, result.found * 8 / 10) << turn;
  }
}

TEST(LandmarkPatch, AnotherWallIsNotTakenForIt) {
  Eigen::Isometry3d elsewhere = own_pose();
  elsewhere.translation().x() += 5;
  const Search result = search(see_wall(elsewhere), Eigen::Vector3d::Zero());
  EXPECT_LE(result.found, result.tried / 4);
}

TEST(LandmarkPatch, NothingIsCutWithoutContrastOrAtTheBorder) {
  const cv::Mat grey(480, 752, CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(cut_landmark_patch(grey, camera(), {0, 0}, kSpacing));
  const ImagePyramid image = see_wall(Eigen::Isometry3d::Identity());
  EXPECT_FALSE(cut_landmark_patch(image.levels[0], camera(), {5, 0}, kSpacing));
}

TEST(LandmarkPatch, HostileNumbersFindNothing) {
  const ImagePyramid image = see_wall(own_pose());
  LandmarkPatch patch{};
  const double nan = std::nan("");
  for (std::size_t i = 0; i < patch.size(); ++i) patch[i] = static_cast<std::uint8_t>(37 * i);
  EXPECT_FALSE(
      find_landmark_patch(image, camera(), {{nan, 0}, 0.1, &patch, kSpacing}, own_pose(), {}));
  EXPECT_FALSE(
      find_landmark_patch(image, camera(), {{0, 0}, nan, &patch, kSpacing}, own_pose(), {}));
  EXPECT_FALSE(find_landmark_patch(image, camera(), {{0, 0}, 0.1, &patch, 1e9}, own_pose(), {}));
  EXPECT_FALSE(find_landmark_patch(image, camera(), {{0, 0}, 0.1, &patch, 0}, own_pose(), {}));
  const LandmarkPatch flat{};
  EXPECT_FALSE(
      find_landmark_patch(image, camera(), {{0, 0}, 0.1, &flat, kSpacing}, own_pose(), {}));
}

}  // namespace
}  // namespace covey
