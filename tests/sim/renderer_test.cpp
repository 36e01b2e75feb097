// SPDX-License-Identifier: Apache-2.0
#include "sim/renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <optional>
#include <vector>

#include "sim/simulation.h"

namespace covey {
namespace {

constexpr int kTexture = 1024;  // texels: quick to make; the geometry is what counts here

struct Frame {
  TimeNs stamp_ns = 0;
  cv::Mat grey;
  cv::Mat depth;
  Eigen::Isometry3d T_world_cam;
};

// Where a pixel of `from` is seen in `to`, by the rendered depth.
std::optional<Eigen::Vector2d> true_match(const CameraIntrinsics& camera, const Frame& from,
                                          const Frame& to, const cv::Point2f& pixel) {
  const float depth = from.depth.at<float>(cvRound(pixel.y), cvRound(pixel.x));
  if (depth >= kSkyDepth) return std::nullopt;
  const auto bearing = unproject(camera, {pixel.x, pixel.y});
  const Eigen::Vector3d p_to =
      to.T_world_cam.inverse() * from.T_world_cam * Eigen::Vector3d(depth * bearing->homogeneous());
  if (p_to.z() < 0.1) return std::nullopt;
  return project(camera, p_to.head<2>() / p_to.z());
}

struct TrackErrors {
  std::size_t count = 0;
  double median_px = 0;
  Eigen::Vector2d mean_px = Eigen::Vector2d::Zero();
};

TrackErrors track(const CameraIntrinsics& camera, const Frame& from, const Frame& to) {
  std::vector<cv::Point2f> corners, tracked;
  cv::goodFeaturesToTrack(from.grey, corners, 400, 0.01, 12);
  std::vector<unsigned char> found;
  std::vector<float> residual;
  cv::calcOpticalFlowPyrLK(from.grey, to.grey, corners, tracked, found, residual);
  std::vector<double> errors;
  TrackErrors result;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const auto truth = true_match(camera, from, to, corners[i]);
    if (!found[i] || !truth) continue;
    const Eigen::Vector2d error = Eigen::Vector2d(tracked[i].x, tracked[i].y) - *truth;
    errors.push_back(error.norm());
    if (error.norm() < 2) result.mean_px += error;
  }
  result.count = errors.size();
  if (errors.empty()) return result;
  result.mean_px /= static_cast<double>(errors.size());
  std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
  result.median_px = errors[errors.size() / 2];
  return result;
}

SimulationRequest request(Scenario scenario) {
  SimulationRequest request;
  request.scenario = scenario;
  request.seed = 5;
  request.agents = 1;
  request.texture_size = kTexture;
  return request;
}

// The images number `first` .. `first + count - 1` of a drone.
std::vector<Frame> frames(DroneSimulation& drone, const Renderer& renderer, const Scene& scene,
                          std::size_t first, std::size_t count) {
  drone.skip_images(first);
  std::vector<Frame> frames;
  for (std::size_t k = first; k < first + count; ++k) {
    Frame frame;
    frame.stamp_ns = drone.image_stamps()[k];
    frame.T_world_cam = drone.camera_pose(frame.stamp_ns);
    frame.depth = renderer.render(scene, frame.T_world_cam).depth;
    frame.grey = drone.next_image().grey;
    frames.push_back(frame);
  }
  return frames;
}

class TrackedScene : public ::testing::TestWithParam<Scenario> {};

TEST_P(TrackedScene, TracksObeyTheTrueGeometry) {
  SimulationRequest asked = request(GetParam());
  asked.duration_s = 6;
  std::vector<DroneSimulation> drones = make_simulation(asked);
  const auto flown = frames(drones[0], drones[0].renderer(), drones[0].scene(), 120, 3);
  for (std::size_t k = 0; k + 1 < flown.size(); ++k) {
    const TrackErrors errors = track(drones[0].renderer().camera(), flown[k], flown[k + 1]);
    EXPECT_GT(errors.count, 150u);
    EXPECT_LT(errors.median_px, 0.3);
    EXPECT_LT(errors.mean_px.norm(), 0.1) << "the image stamp must be the middle of the exposure";
  }
}

INSTANTIATE_TEST_SUITE_P(EveryScenario, TrackedScene,
                         ::testing::Values(Scenario::kCastleAround, Scenario::kCastleParallel,
                                           Scenario::kMarsYard, Scenario::kRoom),
                         [](const auto& test) { return std::string(scenario_name(test.param)); });

TEST(Renderer, SameSeedGivesTheSameBytesAndAnotherSeedOthers) {
  SimulationRequest asked = request(Scenario::kCastleParallel);
  asked.duration_s = 1;
  asked.camera_rate_hz = 2;
  const auto images = [&asked] {
    DroneSimulation drone = make_simulation(asked).front();
    return std::vector<cv::Mat>{drone.next_image().grey, drone.next_image().grey};
  };
  const auto first = images(), again = images();
  for (std::size_t k = 0; k < first.size(); ++k)
    EXPECT_EQ(cv::norm(first[k], again[k], cv::NORM_INF), 0);
  asked.seed = 6;
  EXPECT_GT(cv::norm(first[0], images()[0], cv::NORM_L1) / static_cast<double>(first[0].total()),
            5);
}

// One box in front of the camera: everything about it can be computed by hand.
Scene lonely_box() {
  Scene scene;
  scene.light = {0, 0, -1};  // from behind the camera
  const auto grey = std::make_shared<const Texture>(cv::Mat(4, 4, CV_8UC1, cv::Scalar(255)), 1.0f);
  scene.materials.push_back({grey, grey, 1, 1, 0});
  Primitive box;
  box.center = {0, 0, 5.5f};
  box.half = {1, 1, 0.5f};
  scene.primitives.push_back(box);
  return scene;
}

CameraIntrinsics plain_camera() {
  return {320, 240, 200, 200, 159.5, 119.5, DistortionModel::kRadialTangential, {0, 0, 0, 0}};
}

TEST(Renderer, DepthAndOutlineOfABoxAreExact) {
  const Renderer renderer(plain_camera());
  const Rendering image = renderer.render(lonely_box(), Eigen::Isometry3d::Identity());
  EXPECT_NEAR(image.depth.at<float>(120, 160), 5.0f, 1e-4f);
  EXPECT_EQ(image.depth.at<float>(120, 30), kSkyDepth);
  // 1 m at 5 m, f = 200 px: the face ends 40 px from the middle, between pixels 199 and 200.
  EXPECT_NEAR(image.depth.at<float>(120, 199), 5.0f, 1e-4f);
  EXPECT_EQ(image.depth.at<float>(120, 200), kSkyDepth);
}

TEST(Renderer, EachRowOfARollingShutterIsThatOfAnImageFromWhereItLooks) {
  SimulationRequest request;
  request.scenario = Scenario::kCastleParallel;
  request.agents = 1;
  request.duration_s = 2;
  request.texture_size = kTexture;
  const std::vector<DroneSimulation> drones = make_simulation(request);
  const DroneSimulation& drone = drones.front();
  const TimeNs stamp_ns = drone.image_stamps()[20];
  const Renderer::PoseOfRow pose = [&](int y) {
    return drone.camera_pose(stamp_ns + nanoseconds(3e-5 * y));
  };
  const Rendering rolled = drone.renderer().render(drone.scene(), pose);
  for (const int y : {0, 200, 479}) {
    const Rendering at_once = drone.renderer().render(drone.scene(), pose(y));
    // Surfaces meet elsewhere in the rows beside it, which only the pixels at edges notice.
    const cv::Mat difference = cv::abs(rolled.depth.row(y) - at_once.depth.row(y));
    EXPECT_EQ(cv::countNonZero(difference), 0) << "row " << y;
  }
  const Rendering first = drone.renderer().render(drone.scene(), pose(0));
  EXPECT_GT(cv::countNonZero(cv::abs(rolled.depth.row(479) - first.depth.row(479))), 300);
}

TEST(Renderer, ShutterBlurKeepsTheCentroidAndSpreadsTheEdge) {
  const Renderer renderer(plain_camera());
  const Rendering sharp = renderer.render(lonely_box(), Eigen::Isometry3d::Identity());
  // Moving right at 5 m/s, 5 m away: 200 px/s, 4 px in 20 ms.
  const CameraMotion motion{{5, 0, 0}, {0, 0, 0}};
  const cv::Mat blurred =
      renderer.blur_by_motion(sharp, motion, {TemporalResponse::Shape::kShutter, 0.02});
  const int row = 120;
  const float inside = sharp.radiance.at<float>(row, 150), sky = sharp.radiance.at<float>(row, 240);
  ASSERT_GT(std::abs(inside - sky), 0.05f);
  // The edge inside the face is dragged over two pixels, not beyond.
  EXPECT_NEAR(blurred.at<float>(row, 195), inside, 0.01f);
  EXPECT_GT(std::abs(blurred.at<float>(row, 199) - inside), 0.1f * std::abs(inside - sky));
}

// Of a microbolometer: a step that passes is followed as 1 - exp(-t / tau).
TEST(Renderer, LagFollowsAStepExponentially) {
  const Renderer renderer(plain_camera());
  Rendering sharp;
  sharp.radiance = cv::Mat(240, 320, CV_32FC1, cv::Scalar(0));
  sharp.radiance.colRange(160, 320).setTo(1);
  sharp.depth = cv::Mat(240, 320, CV_32FC1, cv::Scalar(5));
  // Moving right at 5 m/s, 5 m away: the step moves left with 200 px/s, in 20 ms 4 px, in 80 ms 16.
  const CameraMotion motion{{5, 0, 0}, {0, 0, 0}};
  for (const double tau : {0.002, 0.008, 0.02, 0.08}) {
    const cv::Mat lagging =
        renderer.blur_by_motion(sharp, motion, {TemporalResponse::Shape::kExponentialLag, tau});
    const double path = 200 * tau;
    for (int x = 140; x < 240; ++x) {
      // The step's ramp of a pixel is centred on 159.5; the stamp is one tau after the readout.
      const double passed = (x - 159.5 + path) / path;
      const double expected = passed > 0 ? 1 - std::exp(-passed) : 0;
      EXPECT_NEAR(lagging.at<float>(120, x), expected, path < 3 ? 0.2 : 0.06) << tau << " " << x;
    }
  }
}

}  // namespace
}  // namespace covey
