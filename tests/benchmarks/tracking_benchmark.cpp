// SPDX-License-Identifier: Apache-2.0
//
// What one image costs the tracker, whole and by stage: 752x480 px, 200 tracks, 30 Hz, one core.

#include <benchmark/benchmark.h>

#include <opencv2/core/utility.hpp>
#include <vector>

#include "frontend/landmark_patch.h"
#include "frontend/orb.h"
#include "frontend/tracker.h"
#include "tests/frontend/euroc_camera.h"
#include "tests/frontend/synthetic_view.h"

namespace covey {
namespace {

using testing::euroc_camera;
using testing_view::CameraPose;
using testing_view::frame_time;
using testing_view::kFramePeriod;

struct Recording {
  std::vector<CameraPose> poses;
  std::vector<cv::Mat> images;
};

// Rendered once; the benchmarks run it to and fro, so that the motion never jumps.
const Recording& recording() {
  static const Recording recorded = [] {
    cv::setNumThreads(1);
    constexpr int kImages = 30;
    const testing_view::SlantedPlane scene(euroc_camera());
    Recording recording;
    for (int k = 0; k < kImages; ++k) {
      recording.poses.push_back(testing_view::swaying_pose(frame_time(k)));
      recording.images.push_back(scene.image(recording.poses.back(), 1.5, k + 1));
    }
    return recording;
  }();
  return recorded;
}

std::size_t to_and_fro(std::int64_t step) {
  const auto last = static_cast<std::int64_t>(recording().images.size()) - 1;
  const std::int64_t phase = step % (2 * last);
  return static_cast<std::size_t>(phase <= last ? phase : 2 * last - phase);
}

// A tracker that has run through the recording once.
class WarmTracker {
 public:
  WarmTracker() : tracker_(TrackerConfig(), euroc_camera()) {
    for (std::size_t k = 0; k < recording().images.size(); ++k) step();
  }

  const TrackedFrame& step() {
    const std::size_t from = to_and_fro(step_ > 0 ? step_ - 1 : 0), to = to_and_fro(step_);
    const auto R = testing_view::rotation_between(recording().poses[from], recording().poses[to]);
    frame_ = tracker_.track(step_ * kFramePeriod, recording().images[to], R);
    ++step_;
    return frame_;
  }

  void describe() { tracker_.describe(frame_); }

 private:
  Tracker tracker_;
  TrackedFrame frame_;
  std::int64_t step_ = 0;
};

void TrackOneImage(benchmark::State& state) {
  WarmTracker tracker;
  double tracks = 0, added = 0;
  for (auto _ : state) {
    const TrackedFrame& frame = tracker.step();
    tracks += static_cast<double>(frame.features.size());
    added += frame.added;
  }
  state.counters["tracks"] = benchmark::Counter(tracks, benchmark::Counter::kAvgIterations);
  state.counters["added"] = benchmark::Counter(added, benchmark::Counter::kAvgIterations);
}
BENCHMARK(TrackOneImage)->Unit(benchmark::kMillisecond);

void DescribeAllTracks(benchmark::State& state) {
  WarmTracker tracker;
  for (auto _ : state) tracker.describe();
}
BENCHMARK(DescribeAllTracks)->Unit(benchmark::kMillisecond);

void BuildPyramid(benchmark::State& state) {
  const int levels = TrackerConfig().pyramid_levels;
  for (auto _ : state) benchmark::DoNotOptimize(build_pyramid(recording().images[0], levels));
}
BENCHMARK(BuildPyramid)->Unit(benchmark::kMillisecond);

CornerGrid make_grid() {
  const TrackerConfig config;
  return CornerGrid(config.corners, recording().images[0].size(), config.max_tracks);
}

void DetectInAnEmptyImage(benchmark::State& state) {
  for (auto _ : state) {
    CornerGrid grid = make_grid();
    benchmark::DoNotOptimize(grid.detect(recording().images[0], {}, TrackerConfig().max_tracks));
  }
}
BENCHMARK(DetectInAnEmptyImage)->Unit(benchmark::kMillisecond);

void DetectTenMoreCorners(benchmark::State& state) {
  CornerGrid grid = make_grid();
  std::vector<Eigen::Vector2d> tracks = grid.detect(recording().images[0], {}, 200);
  tracks.resize(tracks.size() - 10);
  for (auto _ : state) benchmark::DoNotOptimize(grid.detect(recording().images[0], tracks, 10));
}
BENCHMARK(DetectTenMoreCorners)->Unit(benchmark::kMillisecond);

std::vector<Eigen::Vector2d> corners_of_first_image() {
  return make_grid().detect(recording().images[0], {}, TrackerConfig().max_tracks);
}

void CutAPatch(benchmark::State& state) {
  const TrackerConfig config;
  const ImagePyramid pyramid = build_pyramid(recording().images[0], config.pyramid_levels);
  const std::vector<Eigen::Vector2d> corners = corners_of_first_image();
  std::size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(Patch::cut(pyramid, corners[i++ % corners.size()], config.alignment));
  }
}
BENCHMARK(CutAPatch)->Unit(benchmark::kMicrosecond);

// Argument: pyramid levels used, from a start 1 px away.
void AlignAPatch(benchmark::State& state) {
  const TrackerConfig config;
  const ImagePyramid pyramid = build_pyramid(recording().images[0], config.pyramid_levels);
  const std::vector<Eigen::Vector2d> corners = corners_of_first_image();
  std::vector<Patch> patches;
  std::vector<PatchPlace> starts;
  for (const Eigen::Vector2d& corner : corners) {
    auto patch = Patch::cut(pyramid, corner, config.alignment);
    if (!patch) continue;
    patches.push_back(std::move(*patch));
    PatchPlace start;
    start.pixel = corner + Eigen::Vector2d(0.8, -0.6);
    starts.push_back(start);
  }
  std::size_t i = 0;
  for (auto _ : state) {
    const std::size_t k = i++ % patches.size();
    benchmark::DoNotOptimize(
        patches[k].align(pyramid, starts[k], static_cast<int>(state.range(0)), config.alignment));
  }
}
BENCHMARK(AlignAPatch)->Arg(1)->Arg(2)->Arg(4)->Unit(benchmark::kMicrosecond);

// Corners of the first image, seen from farther aside; the other drone's pose is known to within a
// pixel or two.
void FindALandmark(benchmark::State& state) {
  const CameraIntrinsics camera = euroc_camera();
  const PatchSearchConfig config;
  const double spacing = config.spacing_px / mean_focal_length_px(camera);
  const testing_view::SlantedPlane scene(camera);
  const CameraPose &other = recording().poses[0], &own = recording().poses[12];
  const ImagePyramid pyramid =
      build_pyramid(recording().images[12], TrackerConfig().pyramid_levels);
  std::vector<LandmarkPatch> patches;
  std::vector<SeenLandmark> landmarks;
  for (const Eigen::Vector2d& corner : corners_of_first_image()) {
    const Eigen::Vector2d bearing = unproject(camera, corner).value_or(Eigen::Vector2d::Zero());
    const auto patch = cut_landmark_patch(recording().images[0], camera, bearing, spacing);
    if (!patch) continue;
    patches.push_back(*patch);
    const Eigen::Vector3d p_other =
        other.R_world_cam.transpose() * (scene.point(other, bearing) - other.p_world_cam);
    landmarks.push_back({bearing, 1 / p_other.z(), nullptr, spacing});
  }
  for (std::size_t i = 0; i < patches.size(); ++i) landmarks[i].patch = &patches[i];
  Eigen::Isometry3d T_other_own = Eigen::Isometry3d::Identity();
  T_other_own.linear() = other.R_world_cam.transpose() * own.R_world_cam;
  T_other_own.translation() = other.R_world_cam.transpose() * (own.p_world_cam - other.p_world_cam);
  T_other_own.translation().x() += 0.01;
  std::size_t i = 0, found = 0;
  for (auto _ : state) {
    const SeenLandmark& landmark = landmarks[i++ % landmarks.size()];
    found += find_landmark_patch(pyramid, camera, landmark, T_other_own, config) ? 1U : 0U;
  }
  state.counters["found"] = static_cast<double>(found) / static_cast<double>(i);
}
BENCHMARK(FindALandmark)->Unit(benchmark::kMicrosecond);

void RejectOutliers(benchmark::State& state) {
  const CameraIntrinsics camera = euroc_camera();
  const testing_view::SlantedPlane scene(camera);
  const CameraPose before = recording().poses[0], now = recording().poses[8];
  std::vector<BearingPair> pairs;
  for (const Eigen::Vector2d& corner : corners_of_first_image()) {
    const Eigen::Vector2d bearing = unproject(camera, corner).value_or(Eigen::Vector2d::Zero());
    const Eigen::Vector2d pixel = scene.pixel(now, scene.point(before, bearing));
    pairs.push_back({bearing, unproject(camera, pixel).value_or(bearing)});
  }
  TwoViews views;
  views.R_now_before = testing_view::rotation_between(before, now);
  views.focal_px = camera.fx;
  for (auto _ : state) benchmark::DoNotOptimize(rigid_scene_inliers(pairs, views, {}));
}
BENCHMARK(RejectOutliers)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace covey
