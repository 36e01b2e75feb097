// SPDX-License-Identifier: Apache-2.0
#include "apps/place_survey.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <unordered_map>

#include "apps/camera_pose.h"
#include "apps/grey_image.h"
#include "apps/image_reader.h"
#include "frontend/photometric_calibration.h"
#include "frontend/tracker.h"

namespace covey {
namespace {

// Sum of squared sines of the angles between a point's rays; a third of a pixel per ray makes this
// about 2 % of the distance.
constexpr double kLeastParallax = 1e-3;
constexpr std::size_t kFewestPoints = 20;  // of a view: fewer say nothing about its overlap
const double kLeastCosine = std::cos(30 * 3.14159265358979323846 / 180);
constexpr double kMostScale = 2;

// The point nearest to all rays it was seen along.
class RayBundle {
 public:
  void add(const Eigen::Isometry3d& T_world_cam, const Eigen::Vector2d& bearing) {
    const Eigen::Vector3d ray = (T_world_cam.linear() * bearing.homogeneous()).normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    A_ += across;
    b_ += across * T_world_cam.translation();
  }

  [[nodiscard]] std::optional<Eigen::Vector3d> point() const {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(A_, Eigen::EigenvaluesOnly);
    if (eigen.eigenvalues()[0] < kLeastParallax) return std::nullopt;
    return A_.ldlt().solve(b_);
  }

 private:
  Eigen::Matrix3d A_ = Eigen::Matrix3d::Zero();  // normal equations: A p = b
  Eigen::Vector3d b_ = Eigen::Vector3d::Zero();
};

struct UnfinishedView {
  SurveyedView view;
  std::vector<std::uint64_t> track_ids;
};

class Surveyor {
 public:
  Surveyor(const DroneFolder& drone, const Dataset& dataset, double interval_s, ThermalMode thermal)
      : name_(drone.name),
        dataset_(dataset),
        interval_ns_(nanoseconds(interval_s)),
        reader_(dataset.camera),
        tracker_(TrackerConfig(), dataset.camera, dataset.mask) {
    if (is_calibrated(thermal, dataset.thermal)) {
      calibration_.emplace(PhotometricConfig(),
                           cv::Size(dataset.camera.width, dataset.camera.height), dataset.mask);
    }
  }

  void see(const ImageEntry& image) {
    const TimeNs moment_ns = image.stamp_ns + nanoseconds(dataset_.extrinsics.time_offset_s);
    const auto truth = ground_truth_at(*dataset_.ground_truth, moment_ns);
    if (!truth) return;
    const Eigen::Isometry3d T_world_cam = camera_in_world(truth->pose, dataset_.extrinsics);
    const Eigen::Isometry3d before = T_world_previous_.value_or(T_world_cam);
    const Eigen::Matrix3d R_cam_previous = T_world_cam.linear().transpose() * before.linear();
    const cv::Mat grey = prepared(image, R_cam_previous);
    if (grey.empty()) return;
    TrackedFrame frame = tracker_.track(image.stamp_ns, grey, R_cam_previous);
    if (calibration_) calibration_->observe(tracker_.places());
    T_world_previous_ = T_world_cam;
    for (const TrackedFeature& feature : frame.features) {
      rays_[feature.track_id].add(T_world_cam, feature.bearing);
    }
    if (image.stamp_ns >= next_view_ns_) keep(frame, T_world_cam);
  }

  // With what the whole flight says about the points.
  [[nodiscard]] std::vector<SurveyedView> views() const {
    std::vector<SurveyedView> finished;
    for (const UnfinishedView& unfinished : views_) {
      SurveyedView view = unfinished.view;
      for (const std::uint64_t id : unfinished.track_ids) {
        const auto point = rays_.at(id).point();
        if (point && (view.T_world_cam.inverse() * *point).z() > 0) {
          view.points_world.push_back(*point);
        }
      }
      if (view.points_world.size() >= kFewestPoints) finished.push_back(std::move(view));
    }
    return finished;
  }

 private:
  // Empty where a thermal camera sees nothing, and where the image cannot be read.
  cv::Mat prepared(const ImageEntry& image, const Eigen::Matrix3d& R_cam_previous) {
    const std::optional<cv::Mat> read = reader_.read(image);
    if (!read) return {};
    const cv::Mat& pixels = *read;
    if (!calibration_) return to_grey8(pixels);
    return calibration_
        ->correct(image.stamp_ns, pixels, tracker_.predict(image.stamp_ns, R_cam_previous))
        .pixels;
  }

  void keep(TrackedFrame& frame, const Eigen::Isometry3d& T_world_cam) {
    next_view_ns_ = frame.stamp_ns + interval_ns_;
    tracker_.describe(frame, T_world_cam.linear());
    UnfinishedView unfinished;
    unfinished.view.drone = name_;
    unfinished.view.stamp_ns = frame.stamp_ns;
    unfinished.view.camera = dataset_.camera;
    unfinished.view.T_world_cam = T_world_cam;
    for (const TrackedFeature& feature : frame.features) {
      unfinished.track_ids.push_back(feature.track_id);
      if (feature.described) unfinished.view.features.push_back(feature.descriptor);
    }
    views_.push_back(std::move(unfinished));
  }

  std::string name_;
  const Dataset& dataset_;
  TimeNs interval_ns_;
  ImageReader reader_;
  Tracker tracker_;
  std::optional<PhotometricCalibration> calibration_;
  TimeNs next_view_ns_ = 0;
  std::optional<Eigen::Isometry3d> T_world_previous_;
  std::unordered_map<std::uint64_t, RayBundle> rays_;  // by track
  std::vector<UnfinishedView> views_;
};

bool in_image(const SurveyedView& view, const Eigen::Vector3d& p_world) {
  const Eigen::Vector3d p_cam = view.T_world_cam.inverse() * p_world;
  if (p_cam.z() <= 0) return false;
  const Eigen::Vector2d pixel = project(view.camera, p_cam.hnormalized());
  if (!is_in_image(view.camera, pixel)) return false;
  // Far outside, radial distortion folds back into the image.
  const auto bearing = unproject(view.camera, pixel);
  return bearing && (*bearing - p_cam.hnormalized()).norm() < 1e-3;
}

bool looks_alike(const SurveyedView& from, const SurveyedView& to, const Eigen::Vector3d& p_world) {
  const Eigen::Vector3d ray_from = p_world - from.T_world_cam.translation();
  const Eigen::Vector3d ray_to = p_world - to.T_world_cam.translation();
  const double scale = ray_from.norm() / ray_to.norm();
  return scale < kMostScale && scale * kMostScale > 1 &&
         ray_from.dot(ray_to) > kLeastCosine * ray_from.norm() * ray_to.norm();
}

double share_seen(const SurveyedView& from, const SurveyedView& to) {
  if (from.points_world.empty()) return 0;
  const auto seen = std::count_if(
      from.points_world.begin(), from.points_world.end(),
      [&](const Eigen::Vector3d& p) { return looks_alike(from, to, p) && in_image(to, p); });
  return static_cast<double>(seen) / static_cast<double>(from.points_world.size());
}

}  // namespace

void require_ground_truth(const DroneFolder& drone) {
  const std::filesystem::path truth = ground_truth_file(drone.mav0);
  if (std::filesystem::exists(truth)) return;
  throw std::runtime_error(truth.string() +
                           ": is not there: which views show the same place is not known");
}

std::vector<SurveyedView> survey_flight(const DroneFolder& drone, double interval_s,
                                        ThermalMode thermal, const OnImage& on_image) {
  require_ground_truth(drone);
  const Dataset dataset = read_recording(drone.mav0);
  Surveyor surveyor(drone, dataset, interval_s, thermal);
  std::size_t done = 0;
  for (const ImageEntry& image : dataset.images) {
    surveyor.see(image);
    if (on_image) on_image(++done, dataset.images.size());
  }
  return surveyor.views();
}

double view_overlap(const SurveyedView& a, const SurveyedView& b) {
  return std::min(share_seen(a, b), share_seen(b, a));
}

}  // namespace covey
