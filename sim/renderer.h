// SPDX-License-Identifier: Apache-2.0
//
// Ray casting through the true, distorted camera model: one ray through every pixel centre, more
// where surfaces meet. Pixels that the lens does not reach stay dark: where the distortion cannot
// be inverted, or 72 degrees and more from the axis. What comes out is light (or temperature), not
// grey levels: the sensor models (visual_camera.h, thermal_camera.h) turn it into images.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "frontend/camera.h"
#include "sim/ray_cast.h"
#include "sim/scene.h"

namespace covey {

struct Rendering {
  cv::Mat radiance;  // CV_32FC1, unit as Scene::lighting says
  cv::Mat depth;     // CV_32FC1, z in cam, m; kSkyDepth where there is only sky
};

inline constexpr float kSkyDepth = 1e6f;  // m

// Motion of the camera, in cam, at the middle of the exposure.
struct CameraMotion {
  Eigen::Vector3f velocity_cam = Eigen::Vector3f::Zero();  // m/s
  Eigen::Vector3f rate_cam = Eigen::Vector3f::Zero();      // rad/s
};

// How a pixel gathers what it sees over time. Either way the rendering's instant, the image stamp,
// is the centroid of the response: corners stay where they are at the stamp. A real thermal driver
// stamps the readout, one time constant later; that shift belongs to its calibration.
struct TemporalResponse {
  enum class Shape { kShutter, kExponentialLag };
  Shape shape = Shape::kShutter;
  double duration_s = 0;  // s, shutter time or time constant
};

class Renderer {
 public:
  explicit Renderer(const CameraIntrinsics& camera);

  [[nodiscard]] bool is_lit(int x, int y) const {
    return (bearing(x, y)[0] + bearing(x, y)[1] + bearing(x, y)[stride()]).allFinite();
  }

  // Where the camera is, T_world_cam, when a row of pixels looks: elsewhere for each of a rolling
  // shutter.
  using PoseOfRow = std::function<Eigen::Isometry3d(int y)>;
  [[nodiscard]] Rendering render(const Scene& scene, const PoseOfRow& pose) const;
  [[nodiscard]] Rendering render(const Scene& scene, const Eigen::Isometry3d& T_world_cam) const {
    return render(scene, [&T_world_cam](int) { return T_world_cam; });
  }

  // What a sensor with this response sees: the mean along each pixel's own path.
  [[nodiscard]] cv::Mat blur_by_motion(const Rendering& sharp, const CameraMotion& motion,
                                       const TemporalResponse& response) const;

  [[nodiscard]] const CameraIntrinsics& camera() const { return camera_; }

  struct Tile {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;                     // pixels, end excluded
    Eigen::Vector2f low = Eigen::Vector2f::Constant(1e9f);  // bearings inside, with a margin
    Eigen::Vector2f high = Eigen::Vector2f::Constant(-1e9f);
    float pixel_angle = 0.002f;  // rad, width of a pixel
  };

 private:
  struct View;
  using Views = std::vector<std::shared_ptr<const View>>;
  struct Hits {
    cv::Mat depth;    // CV_32FC1, m
    cv::Mat surface;  // CV_32SC1, see Hit
  };

  [[nodiscard]] int stride() const { return camera_.width + 1; }
  [[nodiscard]] const Eigen::Vector2f* bearing(int x, int y) const {
    return &bearings_[static_cast<std::size_t>(y) * stride() + x];
  }
  [[nodiscard]] const Eigen::Vector2f* most_central_lit(const Tile& tile) const;  // or null
  [[nodiscard]] Tile tile_at(int x0, int y0) const;
  [[nodiscard]] Views views(const Scene& scene, const PoseOfRow& pose) const;
  void cast_tile(const Views& views, const Tile& tile, const std::vector<Candidate>& list,
                 Hits& hits) const;
  void shade_tile(const Views& views, const Tile& tile, const std::vector<Candidate>& list,
                  const Hits& hits, cv::Mat& radiance) const;
  [[nodiscard]] float shade_edge(const View& view, const Tile& tile,
                                 const std::vector<Candidate>& list,
                                 const Eigen::Vector2f* b) const;
  // Velocity in the image, px/s, of what the pixel with bearing *b sees.
  [[nodiscard]] Eigen::Vector2f image_motion(const Eigen::Vector2f* b, float depth,
                                             const CameraMotion& motion) const;

  CameraIntrinsics camera_;
  std::vector<Eigen::Vector2f>
      bearings_;  // of every pixel centre, (width + 1) x (height + 1); NaN: dark
  std::vector<Tile> tiles_;
};

}  // namespace covey
