// SPDX-License-Identifier: Apache-2.0
//
// FAST corners in a grid; each is followed by aligning the patch cut out at its birth, from a place
// predicted by the gyro; outliers rejected by geometry; an ORB descriptor for each track when
// asked.
//
// Single-threaded by design: call cv::setNumThreads(1) once in the program, OpenCV's own threads
// cost more than they bring at this image size.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "frontend/corner_grid.h"
#include "frontend/image_pyramid.h"
#include "frontend/outlier_rejection.h"
#include "frontend/patch_alignment.h"

namespace covey {

struct TrackerConfig {
  int max_tracks = 200;
  // Standard deviation of a corner, px: one that was just found; one that is followed, beside what
  // its alignment claims; and by how much that is to be larger. Errors are as large as claimed, but
  // last: .7 of them are still there in the next image and .25 after ten (rendered flights, true
  // poses), and the filter takes them for noise that does not. Between keyframes little is left of
  // them; where a track is used in every image they add up to `lasting_scale` times as much (the
  // root of 1 + 2 sum of the correlations, 2.4 to 3.9).
  double pixel_sigma = 0.3;
  double aligned_sigma = 0.07;
  double aligned_scale = 3;
  double lasting_scale = 2.7;

  int pyramid_levels = 4;    // the image itself and its halves
  int predicted_levels = 2;  // of them, tried first for a track whose motion is known
  // Of a patch and the image where it was found, -1..1. A patch that no longer looks like itself
  // (an edge before a background, say) slides away long before it is lost: its track ends.
  double min_correlation = 0.92;
  double max_scale = 1.5;          // a patch that grew or shrank more is cut anew, ratio of lengths
  double duplicate_distance = 10;  // of two tracks nearer than this the younger ends, px
  double refill_below = 0.95;  // new corners are looked for with fewer tracks, part of max_tracks
  AlignmentConfig alignment;
  CornerConfig corners;
  OutlierConfig outliers;
};

struct TrackedFeature {
  std::uint64_t track_id = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();             // of `bearing`
  BearingByIntrinsics by_intrinsics = BearingByIntrinsics::Zero();  // TrackObservation
  int length = 1;                                                   // images it has been seen in
  BinaryDescriptor descriptor{};
  bool described = false;
};

// Where the patch of a track lies in an image. A track whose patch is cut anew gets another id
// here: it is another patch of the scene.
struct TrackPlace {
  std::uint64_t patch_id = 0;
  PatchPlace place;
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  // px/s, what rotation does not explain
  // PatchFit::coarse_shift, in the last image; nothing where the patch was cut.
  std::optional<Eigen::Vector2d> coarse_shift = std::nullopt;
};

struct TrackedFrame {
  TimeNs stamp_ns = 0;
  std::vector<TrackedFeature> features;  // oldest track first
  // Tracks, this image: not found again; against the geometry of the others, or duplicates; new.
  int lost = 0, rejected = 0, added = 0;
};

[[nodiscard]] CameraMeasurement to_measurement(const TrackedFrame& frame);

class Tracker {
 public:
  // `mask`: CV_8UC1 of the camera's size, zero where it never sees the scene: legs, propellers,
  // what lies outside a fisheye's circle; empty: nowhere. Nothing is tracked there.
  Tracker(const TrackerConfig& config, const CameraIntrinsics& camera,
          const cv::Mat& mask = cv::Mat());
  ~Tracker();
  Tracker(Tracker&&) noexcept;
  Tracker& operator=(Tracker&&) noexcept;

  // `pixels`: CV_8UC1, the camera's size; copied, its buffer may be reused. `R_cam_previous`:
  // rotation from the previous image's camera to this one's, from the gyro (identity when unknown).
  // Throws std::runtime_error for an image of another type or size.
  TrackedFrame track(TimeNs stamp_ns, const cv::Mat& pixels, const Eigen::Matrix3d& R_cam_previous);

  // The current one, as it is tracked. Its pixels are never written again.
  [[nodiscard]] const ImagePyramid& image() const;

  // Where the tracks are in the last image, and where they will be looked for in the image of that
  // moment.
  [[nodiscard]] std::vector<TrackPlace> places() const;
  [[nodiscard]] std::vector<TrackPlace> predict(TimeNs stamp_ns,
                                                const Eigen::Matrix3d& R_cam_previous) const;

  // ORB descriptors of the current image at the tracks' current places. With the camera's attitude
  // they are oriented by the world: that is what two drones can compare best.
  void describe(TrackedFrame& frame,
                const std::optional<Eigen::Matrix3d>& R_world_cam = std::nullopt) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
