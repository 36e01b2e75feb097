// SPDX-License-Identifier: Apache-2.0
#include "frontend/tracker.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "estimator/bearing.h"
#include "estimator/median.h"
#include "frontend/image_pyramid.h"
#include "frontend/orb.h"

namespace covey {
namespace {

constexpr int kHistory = 16;  // images; the outlier test looks back less far

struct Track {
  explicit Track(Patch cut_at_birth) : patch(std::move(cut_at_birth)) {}

  Patch patch;
  std::uint64_t id = 0;
  std::uint64_t patch_id = 0;
  PatchPlace place;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the pixel
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  // px/s, what rotation does not explain
  std::optional<Eigen::Vector2d> coarse_shift;
  int length = 1;                                       // images
  std::array<Eigen::Vector2d, kHistory> past_bearings;  // [image number % kHistory]
};

// How the rotation of the camera alone moves a place of the image.
struct Turned {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d J;  // d(pixel now)/d(pixel before)
};

std::optional<Turned> turn(const CameraIntrinsics& camera, const Eigen::Vector2d& bearing,
                           const Eigen::Matrix3d& R_cam_previous) {
  const Eigen::Vector3d ray = R_cam_previous * bearing.homogeneous();
  if (ray.z() < 0.1) return std::nullopt;  // turned to the side: out of any pinhole image
  const Eigen::Vector2d bearing_now = ray.hnormalized();
  const Matrix23d J_bearing_ray = bearing_by_point_at_depth_1(bearing_now) / ray.z();
  Eigen::Matrix2d J_before, J_now;
  [[maybe_unused]] const Eigen::Vector2d before = project(camera, bearing, &J_before);
  Turned turned;
  turned.pixel = project(camera, bearing_now, &J_now);
  turned.J = J_now * (J_bearing_ray * R_cam_previous.leftCols<2>()) * J_before.inverse();
  return turned;
}

constexpr int kLeastBorder = 8;  // px, which a patch and a corner's strength reach beyond it

void check(const TrackerConfig& config, const CameraIntrinsics& camera) {
  const auto fail = [](const std::string& what) { throw std::runtime_error("tracker: " + what); };
  if (camera.width < 64 || camera.height < 64) {
    fail("camera image of " + std::to_string(camera.width) + "x" + std::to_string(camera.height) +
         " px is smaller than 64x64 px: check `resolution` of the camera");
  }
  if (!(camera.fx > 0 && camera.fy > 0)) fail("focal length is not positive: check `intrinsics`");
  if (config.max_tracks < 1) fail("max_tracks must be at least 1");
  if (config.corners.border < kLeastBorder) {
    fail("corner_border_px must be at least " + std::to_string(kLeastBorder));
  }
  if (config.pyramid_levels < 1 || config.pyramid_levels > 6) fail("pyramid_levels must be 1..6");
  if (config.outliers.max_lag < 2 || config.outliers.max_lag >= kHistory) {
    fail("outliers.max_lag must be 2.." + std::to_string(kHistory - 1));
  }
}

void check(const CameraIntrinsics& camera, const cv::Mat& pixels) {
  if (pixels.type() != CV_8UC1) {
    throw std::runtime_error("tracker: image is not 8-bit grey (OpenCV type " +
                             std::to_string(pixels.type()) + "): convert it first");
  }
  if (pixels.cols != camera.width || pixels.rows != camera.height) {
    throw std::runtime_error("tracker: image is " + std::to_string(pixels.cols) + "x" +
                             std::to_string(pixels.rows) + " px, the camera's calibration is for " +
                             std::to_string(camera.width) + "x" + std::to_string(camera.height));
  }
}

void check_mask(const CameraIntrinsics& camera, const cv::Mat& mask) {
  if (mask.empty()) return;
  if (mask.type() != CV_8UC1 || mask.cols != camera.width || mask.rows != camera.height)
    throw std::runtime_error("tracker: the mask is not 8-bit grey of the camera's size");
}

// Where a whole patch shows the scene.
cv::Mat patch_centres(const cv::Mat& mask) {
  cv::Mat centres;
  if (mask.empty()) return centres;
  constexpr int kSide = 2 * kLeastBorder + 1;
  cv::erode(mask, centres, cv::getStructuringElement(cv::MORPH_RECT, {kSide, kSide}));
  return centres;
}

}  // namespace

struct Tracker::Impl {
  TrackerConfig config;
  CameraIntrinsics camera;
  cv::Mat usable;  // patch_centres
  CornerGrid corners;
  ImagePyramid current;
  std::vector<Track> tracks;  // oldest first
  std::uint64_t next_id = 1, next_patch_id = 1;
  std::int64_t image_number = 0;
  // [k]: of the image k before the current one. `rotations` takes its bearings to the current
  // camera.
  std::array<Eigen::Matrix3d, kHistory> rotations;
  std::array<TimeNs, kHistory> stamps{};

  Impl(const TrackerConfig& tracker_config, const CameraIntrinsics& intrinsics,
       const cv::Mat& patch_centres)
      : config(tracker_config),
        camera(intrinsics),
        usable(patch_centres),
        corners(tracker_config.corners, {intrinsics.width, intrinsics.height},
                tracker_config.max_tracks, patch_centres) {
    rotations.fill(Eigen::Matrix3d::Identity());
  }

  void remember(TimeNs stamp_ns, const Eigen::Matrix3d& R_cam_previous) {
    for (std::size_t k = kHistory - 1; k > 0; --k) {
      rotations[k] = R_cam_previous * rotations[k - 1];
      stamps[k] = stamps[k - 1];
    }
    rotations[0].setIdentity();
    stamps[0] = stamp_ns;
  }

  // A good prediction needs no coarse level; without one, or when it fails, all of them help.
  std::optional<PatchFit> find(const Patch& patch, const PatchPlace& start, bool predicted) const {
    const int few = std::min(config.predicted_levels, config.pyramid_levels);
    for (const int levels : {predicted ? few : config.pyramid_levels, config.pyramid_levels}) {
      const auto found = patch.align(current, start, levels, config.alignment);
      if (found && found->correlation >= config.min_correlation) return found;
      if (levels == config.pyramid_levels) break;
    }
    return std::nullopt;
  }

  // Pixels of the patch and of the image must stay about the same size.
  void keep_scale(Track& track) {
    const double area_ratio = std::abs(track.place.affine.determinant());
    const double limit = config.max_scale * config.max_scale;
    if (area_ratio < limit && area_ratio * limit > 1) return;
    auto patch = Patch::cut(current, track.place.pixel, config.alignment);
    if (!patch) return;
    track.patch = std::move(*patch);
    track.patch_id = next_patch_id++;
    track.place.affine.setIdentity();
    track.coarse_shift.reset();
  }

  bool is_usable(const Eigen::Vector2d& pixel) const {
    const cv::Point nearest(static_cast<int>(std::lround(pixel.x())),
                            static_cast<int>(std::lround(pixel.y())));
    return usable.empty() || (nearest.inside(cv::Rect({0, 0}, usable.size())) &&
                              usable.at<std::uint8_t>(nearest) != 0);
  }

  bool follow(Track& track, const Turned& turned, double dt) {
    PatchPlace start;
    start.pixel = turned.pixel + dt * track.velocity;
    start.affine = turned.J * track.place.affine;
    const std::optional<PatchFit> found = find(track.patch, start, track.length > 1);
    if (!found || !is_usable(found->place.pixel)) return false;
    const auto bearing = unproject(camera, found->place.pixel);
    if (!bearing) return false;
    track.place = found->place;
    track.coarse_shift = found->coarse_shift;
    track.covariance = config.aligned_sigma * config.aligned_sigma * Eigen::Matrix2d::Identity() +
                       config.aligned_scale * config.aligned_scale * found->covariance;
    track.bearing = *bearing;
    track.velocity =
        dt > 0 ? Eigen::Vector2d((track.place.pixel - turned.pixel) / dt) : Eigen::Vector2d::Zero();
    ++track.length;
    keep_scale(track);
    return true;
  }

  int follow_all(const Eigen::Matrix3d& R_cam_previous) {
    const double dt = std::max(0.0, seconds_between(stamps[1], stamps[0]));
    std::vector<Track> alive;
    alive.reserve(tracks.size());
    for (Track& track : tracks) {
      const auto turned = turn(camera, track.bearing, R_cam_previous);
      if (turned && follow(track, *turned, dt)) alive.push_back(std::move(track));
    }
    const auto lost = tracks.size() - alive.size();
    tracks = std::move(alive);
    return static_cast<int>(lost);
  }

  void keep_only(const std::vector<bool>& keep) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < tracks.size(); ++i) {
      if (!keep[i]) continue;
      if (kept != i) tracks[kept] = std::move(tracks[i]);
      ++kept;
    }
    tracks.erase(tracks.begin() + static_cast<std::ptrdiff_t>(kept), tracks.end());
  }

  std::size_t history_slot(int images_ago) const {
    return static_cast<std::size_t>((image_number - images_ago + kHistory) % kHistory);
  }

  // How many images ago the camera was so far away that an outlier shows.
  int outlier_lag() const {
    std::vector<double> flows;
    for (const Track& track : tracks) {
      if (track.length > 1) flows.push_back(track.velocity.norm());
    }
    if (flows.empty()) return config.outliers.max_lag;
    const double flow = median(std::move(flows)) * seconds_between(stamps[1], stamps[0]);  // px
    const double images = config.outliers.parallax_px / std::max(flow, 1e-3);
    return static_cast<int>(std::clamp(std::ceil(images), 2.0, 1.0 * config.outliers.max_lag));
  }

  void reject_against(int lag, std::vector<bool>& keep) const {
    std::vector<BearingPair> pairs;
    std::vector<std::size_t> index;
    for (std::size_t i = 0; i < tracks.size(); ++i) {
      if (!keep[i] || tracks[i].length <= lag) continue;
      pairs.push_back({tracks[i].past_bearings[history_slot(lag)], tracks[i].bearing});
      index.push_back(i);
    }
    TwoViews views;
    views.R_now_before = rotations[static_cast<std::size_t>(lag)];
    const double seconds = seconds_between(stamps[static_cast<std::size_t>(lag)], stamps[0]);
    views.rotation_sigma = std::max(1e-4, config.outliers.gyro_sigma * seconds);
    views.focal_px = std::sqrt(camera.fx * camera.fy);
    const std::vector<bool> inliers = rigid_scene_inliers(pairs, views, config.outliers);
    for (std::size_t k = 0; k < index.size(); ++k) {
      if (!inliers[k]) keep[index[k]] = false;
    }
  }

  void reject_duplicates(std::vector<bool>& keep) const {
    const double limit = config.duplicate_distance * config.duplicate_distance;
    for (std::size_t i = 0; i < tracks.size(); ++i) {
      for (std::size_t older = 0; older < i && keep[i]; ++older) {
        if (!keep[older]) continue;
        const double d2 = (tracks[i].place.pixel - tracks[older].place.pixel).squaredNorm();
        if (d2 < limit) keep[i] = false;
      }
    }
  }

  int reject() {
    std::vector<bool> keep(tracks.size(), true);
    const int lag = outlier_lag();
    reject_against(lag, keep);
    if (lag > 2) reject_against(2, keep);  // those too young for the long baseline
    reject_duplicates(keep);
    const auto rejected = std::count(keep.begin(), keep.end(), false);
    keep_only(keep);
    return static_cast<int>(rejected);
  }

  // A new track moves like the one next to it until it is known better.
  Eigen::Vector2d neighbour_velocity(const Eigen::Vector2d& pixel, std::size_t known) const {
    Eigen::Vector2d velocity = Eigen::Vector2d::Zero();
    double nearest = std::numeric_limits<double>::max();
    for (std::size_t i = 0; i < known; ++i) {
      const double d2 = (tracks[i].place.pixel - pixel).squaredNorm();
      if (tracks[i].length < 2 || d2 >= nearest) continue;
      nearest = d2;
      velocity = tracks[i].velocity;
    }
    return velocity;
  }

  int add_corners() {
    const int count = static_cast<int>(tracks.size());
    if (count >= config.refill_below * config.max_tracks) return 0;
    std::vector<Eigen::Vector2d> existing;
    for (const Track& track : tracks) existing.push_back(track.place.pixel);
    const std::size_t known = tracks.size();
    const auto found = corners.detect(current.levels[0], existing, config.max_tracks - count);
    for (const Eigen::Vector2d& pixel : found) {
      const auto bearing = unproject(camera, pixel);
      auto patch = Patch::cut(current, pixel, config.alignment);
      if (!bearing || !patch) continue;
      Track track(std::move(*patch));
      track.id = next_id++;
      track.patch_id = next_patch_id++;
      track.place.pixel = pixel;
      track.covariance = config.pixel_sigma * config.pixel_sigma * Eigen::Matrix2d::Identity();
      track.bearing = *bearing;
      track.velocity = neighbour_velocity(pixel, known);
      tracks.push_back(std::move(track));
    }
    return static_cast<int>(tracks.size() - known);
  }

  TrackedFeature feature(const Track& track) const {
    TrackedFeature feature;
    feature.track_id = track.id;
    feature.pixel = track.place.pixel;
    feature.bearing = track.bearing;
    feature.covariance = bearing_covariance(camera, track.bearing, track.covariance);
    feature.by_intrinsics = bearing_by_intrinsics(camera, track.bearing);
    feature.length = track.length;
    return feature;
  }
};

CameraMeasurement to_measurement(const TrackedFrame& frame) {
  CameraMeasurement measurement;
  measurement.stamp_ns = frame.stamp_ns;
  measurement.tracks.reserve(frame.features.size());
  for (const TrackedFeature& feature : frame.features) {
    measurement.tracks.push_back(
        {feature.track_id, feature.bearing, feature.covariance, feature.by_intrinsics});
  }
  return measurement;
}

Tracker::Tracker(const TrackerConfig& config, const CameraIntrinsics& camera, const cv::Mat& mask) {
  check(config, camera);
  check_mask(camera, mask);
  impl_ = std::make_unique<Impl>(config, camera, patch_centres(mask));
}
Tracker::~Tracker() = default;
Tracker::Tracker(Tracker&&) noexcept = default;
Tracker& Tracker::operator=(Tracker&&) noexcept = default;

TrackedFrame Tracker::track(TimeNs stamp_ns, const cv::Mat& pixels,
                            const Eigen::Matrix3d& R_cam_previous) {
  Impl& self = *impl_;
  check(self.camera, pixels);
  self.current = build_pyramid(pixels, self.config.pyramid_levels);
  self.remember(stamp_ns, R_cam_previous);
  ++self.image_number;

  TrackedFrame frame;
  frame.stamp_ns = stamp_ns;
  frame.lost = self.follow_all(R_cam_previous);
  frame.rejected = self.reject();
  frame.added = self.add_corners();
  for (Track& track : self.tracks) {
    track.past_bearings[self.history_slot(0)] = track.bearing;
    frame.features.push_back(self.feature(track));
  }
  return frame;
}

const ImagePyramid& Tracker::image() const { return impl_->current; }

std::vector<TrackPlace> Tracker::places() const {
  std::vector<TrackPlace> places;
  places.reserve(impl_->tracks.size());
  for (const Track& track : impl_->tracks) {
    places.push_back({track.patch_id, track.place, track.velocity, track.coarse_shift});
  }
  return places;
}

std::vector<TrackPlace> Tracker::predict(TimeNs stamp_ns,
                                         const Eigen::Matrix3d& R_cam_previous) const {
  const double dt = std::max(0.0, seconds_between(impl_->stamps[0], stamp_ns));
  std::vector<TrackPlace> places;
  places.reserve(impl_->tracks.size());
  for (const Track& track : impl_->tracks) {
    const auto turned = turn(impl_->camera, track.bearing, R_cam_previous);
    if (!turned) continue;
    const PatchPlace place{turned->pixel + dt * track.velocity, turned->J * track.place.affine};
    places.push_back({track.patch_id, place, track.velocity, {}});
  }
  return places;
}

void Tracker::describe(TrackedFrame& frame,
                       const std::optional<Eigen::Matrix3d>& R_world_cam) const {
  if (impl_->current.levels.empty()) return;
  std::vector<Eigen::Vector2d> pixels, bearings;
  for (const TrackedFeature& feature : frame.features) {
    pixels.push_back(feature.pixel);
    bearings.push_back(feature.bearing);
  }
  std::vector<float> directions_deg;
  if (R_world_cam) directions_deg = world_directions_deg(impl_->camera, bearings, *R_world_cam);
  const auto descriptors = describe_places(impl_->current.levels[0], pixels, directions_deg);
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    frame.features[i].described = descriptors[i].has_value();
    if (descriptors[i]) frame.features[i].descriptor = *descriptors[i];
  }
}

}  // namespace covey
