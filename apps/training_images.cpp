// SPDX-License-Identifier: Apache-2.0
#include "apps/training_images.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "apps/camera_pose.h"
#include "apps/dataset.h"
#include "apps/grey_image.h"
#include "apps/image_reader.h"
#include "apps/png_file.h"
#include "frontend/orb.h"
#include "frontend/tracker.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

constexpr int kLooks = 4;            // until each cell's threshold fits its contrast
constexpr int kSmallestSide = 64;    // px, as for the tracker
constexpr float kDownwardsDeg = 90;  // from image x towards image y

std::vector<Eigen::Vector2d> find_corners(const cv::Mat& grey) {
  const TrackerConfig config;
  CornerGrid grid(config.corners, grey.size(), config.max_tracks);
  std::vector<Eigen::Vector2d> corners;
  for (int look = 0; look < kLooks; ++look) {
    const int wanted = config.max_tracks - static_cast<int>(corners.size());
    const auto found = grid.detect(grey, corners, wanted);
    corners.insert(corners.end(), found.begin(), found.end());
  }
  return corners;
}

void add_image(TrainingSet& set, const cv::Mat& grey, const std::vector<Eigen::Vector2d>& corners,
               const std::vector<float>& directions_deg) {
  ++set.images;
  for (const auto& descriptor : describe_places(grey, corners, directions_deg)) {
    if (descriptor) set.descriptors.push_back(*descriptor);
  }
}

void add_upright(TrainingSet& set, const cv::Mat& grey) {
  const std::vector<Eigen::Vector2d> corners = find_corners(grey);
  add_image(set, grey, corners, std::vector<float>(corners.size(), kDownwardsDeg));
}

void add_oriented(TrainingSet& set, const cv::Mat& grey, const CameraIntrinsics& camera,
                  const Eigen::Matrix3d& R_world_cam) {
  std::vector<Eigen::Vector2d> corners, bearings;
  for (const Eigen::Vector2d& corner : find_corners(grey)) {
    const auto bearing = unproject(camera, corner);
    if (!bearing) continue;
    corners.push_back(corner);
    bearings.push_back(*bearing);
  }
  add_image(set, grey, corners, world_directions_deg(camera, bearings, R_world_cam));
}

// `count` of them, evenly spread.
template <typename Item>
std::vector<Item> spread(const std::vector<Item>& all, std::size_t count) {
  if (all.size() <= count) return all;
  std::vector<Item> chosen;
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(all[i * all.size() / count]);
  return chosen;
}

TrainingSet describe_drone(const DroneFolder& drone, std::size_t count) {
  const Dataset dataset = read_dataset(drone.mav0);
  const TimeNs offset_ns = nanoseconds(dataset.extrinsics.time_offset_s);
  ImageReader reader(dataset.camera);
  TrainingSet set;
  for (const ImageEntry& image : spread(dataset.images, count)) {
    const std::optional<cv::Mat> pixels = reader.read(image);
    if (!pixels) continue;
    const cv::Mat grey = to_grey8(*pixels);
    if (!dataset.ground_truth) {
      add_upright(set, grey);
    } else if (const auto truth =
                   ground_truth_at(*dataset.ground_truth, image.stamp_ns + offset_ns)) {
      add_oriented(set, grey, dataset.camera,
                   camera_in_world(truth->pose, dataset.extrinsics).linear());
    }
  }
  return set;
}

std::vector<fs::path> png_files(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.path().extension() == ".png") {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

TrainingSet describe_files(const std::vector<fs::path>& files) {
  TrainingSet set;
  for (const fs::path& file : files) {
    const cv::Mat grey = to_grey8(read_png(file.string()));
    if (std::min(grey.cols, grey.rows) < kSmallestSide) {
      throw std::runtime_error(file.string() + ": is smaller than 64x64 pixels");
    }
    add_upright(set, grey);
  }
  return set;
}

}  // namespace

void TrainingSet::add(const TrainingSet& other) {
  images += other.images;
  descriptors.insert(descriptors.end(), other.descriptors.begin(), other.descriptors.end());
}

TrainingSet describe_training_images(const fs::path& folder, std::size_t images_per_camera) {
  if (!fs::is_directory(folder)) {
    throw std::runtime_error(folder.string() + ": is not a folder: is the path right?");
  }
  const std::vector<fs::path> files = png_files(folder);
  if (!files.empty()) return describe_files(spread(files, images_per_camera));
  TrainingSet set;
  for (const DroneFolder& drone : find_drones(folder)) {
    set.add(describe_drone(drone, images_per_camera));
  }
  return set;
}

}  // namespace covey
