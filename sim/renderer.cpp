// SPDX-License-Identifier: Apache-2.0
#include "sim/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace covey {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr int kTileSide = 16;          // pixels
constexpr float kNearPlane = 0.02f;    // m
constexpr float kWidestCosine = 0.3f;  // of the angle from the optical axis to any lit pixel
constexpr int kNoSurface = -2;         // of dark pixels; see Hit
const Vector2f kDark = Vector2f::Constant(std::numeric_limits<float>::quiet_NaN());

struct Rect {
  Vector2f low = Vector2f::Constant(1e9f), high = Vector2f::Constant(-1e9f);
  float near_depth = 1e9f;

  void add(const Vector3f& p_cam) {
    const Vector2f bearing = p_cam.head<2>() / p_cam.z();
    low = low.cwiseMin(bearing);
    high = high.cwiseMax(bearing);
    near_depth = std::min(near_depth, p_cam.z());
  }
};

bool unbounded(Shape shape) {
  return shape == Shape::kGround || shape == Shape::kRoom || shape == Shape::kSkyline;
}

// Distance from the camera to a surface without a bounding box.
float clearance(const Primitive& p, const Vector3f& p_world_cam) {
  const Vector3f offset = p_world_cam - p.center;
  if (p.shape == Shape::kGround) return std::max(0.0f, offset.z());
  if (p.shape == Shape::kSkyline) return std::max(0.0f, p.half.x() - offset.head<2>().norm());
  return 0.0f;
}

std::array<Vector3f, 8> corners_in_cam(const Primitive& p, const Eigen::Isometry3f& T_cam_world) {
  const float c = std::cos(p.yaw), s = std::sin(p.yaw);
  Vector3f half = p.half;
  if (p.shape == Shape::kFrustum) half.x() = half.y() = std::max(p.half.x(), p.half.y());
  std::array<Vector3f, 8> corners;
  for (int i = 0; i < 8; ++i) {
    const Vector3f local((i & 1) ? half.x() : -half.x(), (i & 2) ? half.y() : -half.y(),
                         (i & 4) ? half.z() : -half.z());
    const Vector3f turned(c * local.x() - s * local.y(), s * local.x() + c * local.y(), local.z());
    corners[i] = T_cam_world * (p.center + turned);
  }
  return corners;
}

// Bearings covered by the bounding box, its edges cut at the near plane.
Rect bounds_in_cam(const std::array<Vector3f, 8>& corners) {
  Rect rect;
  for (int i = 0; i < 8; ++i)
    for (int bit = 1; bit < 8; bit <<= 1) {
      if (i & bit) continue;
      const Vector3f &a = corners[i], &b = corners[i | bit];
      if (a.z() >= kNearPlane) rect.add(a);
      if (b.z() >= kNearPlane) rect.add(b);
      if ((a.z() < kNearPlane) != (b.z() < kNearPlane)) {
        const float blend = (kNearPlane - a.z()) / (b.z() - a.z());
        Vector3f cut = a + blend * (b - a);
        cut.z() = kNearPlane;
        rect.add(cut);
      }
    }
  return rect;
}

using Candidates = std::vector<std::vector<Candidate>>;  // of each tile, nearest first

// The primitives that may be seen in the tiles from `begin` up to `end`.
void find_candidates(const Scene& scene, const Eigen::Isometry3f& T_cam_world,
                     const std::vector<Renderer::Tile>& tiles, std::size_t begin, std::size_t end,
                     Candidates& lists) {
  const Vector3f p_world_cam = T_cam_world.inverse().translation();
  for (std::size_t i = 0; i < scene.primitives.size(); ++i) {
    const int index = static_cast<int>(i);
    if (unbounded(scene.primitives[i].shape)) {
      const float near_depth = kWidestCosine * clearance(scene.primitives[i], p_world_cam);
      for (std::size_t t = begin; t < end; ++t) lists[t].push_back({near_depth, index});
      continue;
    }
    const Rect rect = bounds_in_cam(corners_in_cam(scene.primitives[i], T_cam_world));
    if (rect.near_depth > 1e8f) continue;  // behind the camera
    for (std::size_t t = begin; t < end; ++t)
      if ((rect.low.array() <= tiles[t].high.array()).all() &&
          (rect.high.array() >= tiles[t].low.array()).all())
        lists[t].push_back({rect.near_depth, index});
  }
  for (std::size_t t = begin; t < end; ++t)
    std::sort(lists[t].begin(), lists[t].end(), [](const Candidate& a, const Candidate& b) {
      return a.near_depth != b.near_depth ? a.near_depth < b.near_depth : a.primitive < b.primitive;
    });
}

// Each row of tiles from where its middle looks: the rest of it is less than a pixel off.
Candidates candidates_per_tile(const Scene& scene, const Renderer::PoseOfRow& pose,
                               const std::vector<Renderer::Tile>& tiles) {
  Candidates lists(tiles.size());
  for (std::size_t begin = 0, end = 0; begin < tiles.size(); begin = end) {
    while (end < tiles.size() && tiles[end].y0 == tiles[begin].y0) ++end;
    const Eigen::Isometry3d T_world_cam = pose((tiles[begin].y0 + tiles[begin].y1) / 2);
    find_candidates(scene, T_world_cam.inverse().cast<float>(), tiles, begin, end, lists);
  }
  return lists;
}

// A pixel where another surface is seen next door needs more than one ray.
bool on_edge(const cv::Mat& surfaces, int x, int y) {
  const int* row = surfaces.ptr<int>(y);
  const int here = row[x];
  if (x > 0 && row[x - 1] != here) return true;
  if (x + 1 < surfaces.cols && row[x + 1] != here) return true;
  if (y > 0 && surfaces.ptr<int>(y - 1)[x] != here) return true;
  return y + 1 < surfaces.rows && surfaces.ptr<int>(y + 1)[x] != here;
}

float bilinear(const cv::Mat& image, float x, float y) {
  x = std::clamp(x, 0.0f, static_cast<float>(image.cols) - 1.001f);
  y = std::clamp(y, 0.0f, static_cast<float>(image.rows) - 1.001f);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  const float* a = image.ptr<float>(y0) + x0;
  const float* b = image.ptr<float>(y0 + 1) + x0;
  const float top = a[0] + fx * (a[1] - a[0]), bottom = b[0] + fx * (b[1] - b[0]);
  return top + fy * (bottom - top);
}

// When a pixel looks, from the stamp on, in units of the response's duration, and how much of the
// whole that is.
struct Look {
  float instant = 0, weight = 0;
};
using Looks = std::vector<Look>;

Looks looks_of_shutter(std::size_t count) {
  Looks looks(count);
  for (std::size_t k = 0; k < count; ++k) {
    const float share = (static_cast<float>(k) + 0.5f) / static_cast<float>(count);
    looks[k] = {share - 0.5f, 1 / static_cast<float>(count)};
  }
  return looks;
}

// What was seen s ago counts exp(-s). Between looks, denser where that is large, what is seen is
// taken to change linearly: so mean, spread and skew are those of the exponential.
Looks looks_of_lag(std::size_t count) {
  constexpr float kReach = 6;
  std::vector<float> ago(count), weight(count);
  for (std::size_t k = 0; k < count; ++k)
    ago[k] = kReach * std::pow(static_cast<float>(k) / static_cast<float>(count - 1), 1.5f);
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const float width = ago[k + 1] - ago[k];
    const float near = std::exp(-ago[k]), far = std::exp(-ago[k + 1]);
    const float of_older = (near - far * (1 + width)) / width;
    weight[k] += near - far - of_older;
    weight[k + 1] += of_older;
  }
  weight.back() += std::exp(-kReach);
  float mean_ago = 0;
  for (std::size_t k = 0; k < count; ++k) mean_ago += weight[k] * ago[k];
  Looks looks(count);
  for (std::size_t k = 0; k < count; ++k) looks[k] = {mean_ago - ago[k], weight[k]};
  return looks;
}

// [n]: about one look for each pixel of a path of n px, or several where the response is uneven.
constexpr std::size_t kLongestPath = 20;  // px; longer ones are looked at more coarsely
std::vector<Looks> looks_by_path(TemporalResponse::Shape shape) {
  std::vector<Looks> table(kLongestPath + 1);
  for (std::size_t n = 0; n <= kLongestPath; ++n)
    table[n] = shape == TemporalResponse::Shape::kShutter ? looks_of_shutter(2 + n)
                                                          : looks_of_lag(9 + 6 * n);
  return table;
}

}  // namespace

Renderer::Renderer(const CameraIntrinsics& camera) : camera_(camera) {
  const double widest = std::sqrt(1 / (kWidestCosine * kWidestCosine) - 1);
  bearings_.reserve(static_cast<std::size_t>(stride()) * (camera.height + 1));
  for (int y = 0; y <= camera.height; ++y)
    for (int x = 0; x <= camera.width; ++x) {
      const auto bearing = unproject(camera, Eigen::Vector2d(x, y));
      const bool lit = bearing && bearing->norm() < widest;
      bearings_.push_back(lit ? bearing->cast<float>() : kDark);
    }
  for (int y = 0; y < camera.height; y += kTileSide)
    for (int x = 0; x < camera.width; x += kTileSide) tiles_.push_back(tile_at(x, y));
}

const Vector2f* Renderer::most_central_lit(const Tile& tile) const {
  const int x_middle = (tile.x0 + tile.x1) / 2, y_middle = (tile.y0 + tile.y1) / 2;
  const Vector2f* best = nullptr;
  int least = std::numeric_limits<int>::max();
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x) {
      const int distance = std::abs(x - x_middle) + std::abs(y - y_middle);
      if (distance >= least || !is_lit(x, y)) continue;
      best = bearing(x, y);
      least = distance;
    }
  return best;
}

Renderer::Tile Renderer::tile_at(int x0, int y0) const {
  Tile tile;
  tile.x0 = x0;
  tile.y0 = y0;
  tile.x1 = std::min(x0 + kTileSide, camera_.width);
  tile.y1 = std::min(y0 + kTileSide, camera_.height);
  for (int y = y0; y <= tile.y1; ++y)
    for (int x = x0; x <= tile.x1; ++x) {
      if (!bearing(x, y)->allFinite()) continue;
      tile.low = tile.low.cwiseMin(*bearing(x, y));
      tile.high = tile.high.cwiseMax(*bearing(x, y));
    }
  const Vector2f* b = most_central_lit(tile);
  if (b == nullptr) return tile;
  // The pixel's width of view from its solid angle; and room for the samples of border pixels.
  const Vector2f right = b[1] - b[0], down = b[stride()] - b[0];
  const float area = std::abs(right.x() * down.y() - right.y() * down.x());
  tile.pixel_angle = std::sqrt(area / std::pow(b->homogeneous().squaredNorm(), 1.5f));
  const float margin = std::max(right.norm(), down.norm());
  tile.low.array() -= margin;
  tile.high.array() += margin;
  return tile;
}

struct Renderer::View {
  RayCaster caster;
  Eigen::Matrix3f R_world_cam;
};

// One for each row of pixels; rows that look from one place share it.
Renderer::Views Renderer::views(const Scene& scene, const PoseOfRow& pose) const {
  Views views;
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  for (int y = 0; y < camera_.height; ++y) {
    const Eigen::Isometry3d of_row = pose(y);
    if (!views.empty() && of_row.matrix() == T_world_cam.matrix()) {
      views.push_back(views.back());
      continue;
    }
    T_world_cam = of_row;
    views.push_back(
        std::make_shared<View>(View{RayCaster(scene, T_world_cam.translation().cast<float>()),
                                    T_world_cam.linear().cast<float>()}));
  }
  return views;
}

void Renderer::cast_tile(const Views& views, const Tile& tile, const std::vector<Candidate>& list,
                         Hits& hits) const {
  for (int y = tile.y0; y < tile.y1; ++y) {
    const View& view = *views[static_cast<std::size_t>(y)];
    for (int x = tile.x0; x < tile.x1; ++x) {
      if (!is_lit(x, y)) continue;
      const Hit hit = view.caster.cast(view.R_world_cam * bearing(x, y)->homogeneous(), list.data(),
                                       list.data() + list.size());
      hits.depth.at<float>(y, x) = hit.depth;
      hits.surface.at<int>(y, x) = hit.surface;
    }
  }
}

// The mean of four samples. Rotated grid: no two share a row or a column, so that straight edges
// get four levels.
float Renderer::shade_edge(const View& view, const Tile& tile, const std::vector<Candidate>& list,
                           const Vector2f* b) const {
  const std::array<Vector2f, 4> grid{Vector2f(-0.125f, -0.375f), Vector2f(0.375f, -0.125f),
                                     Vector2f(0.125f, 0.375f), Vector2f(-0.375f, 0.125f)};
  const Vector2f right = b[1] - b[0], down = b[stride()] - b[0];
  float sum = 0;
  for (const Vector2f& offset : grid) {
    const Vector2f sample = b[0] + offset.x() * right + offset.y() * down;
    const Vector3f direction = view.R_world_cam * sample.homogeneous();
    const Hit hit = view.caster.cast(direction, list.data(), list.data() + list.size());
    sum += view.caster.shade(direction, hit, tile.pixel_angle);
  }
  return sum / static_cast<float>(grid.size());
}

void Renderer::shade_tile(const Views& views, const Tile& tile, const std::vector<Candidate>& list,
                          const Hits& hits, cv::Mat& radiance) const {
  for (int y = tile.y0; y < tile.y1; ++y) {
    const View& view = *views[static_cast<std::size_t>(y)];
    for (int x = tile.x0; x < tile.x1; ++x) {
      if (!is_lit(x, y)) continue;
      const Vector2f* b = bearing(x, y);
      const Hit hit{hits.depth.at<float>(y, x), hits.surface.at<int>(y, x)};
      radiance.at<float>(y, x) =
          on_edge(hits.surface, x, y)
              ? shade_edge(view, tile, list, b)
              : view.caster.shade(view.R_world_cam * b->homogeneous(), hit, tile.pixel_angle);
    }
  }
}

Rendering Renderer::render(const Scene& scene, const PoseOfRow& pose) const {
  const Views views = this->views(scene, pose);
  const auto lists = candidates_per_tile(scene, pose, tiles_);
  const cv::Size size(camera_.width, camera_.height);
  Hits hits{cv::Mat(size, CV_32FC1, cv::Scalar(kSkyDepth)),
            cv::Mat(size, CV_32SC1, cv::Scalar(kNoSurface))};
  for (std::size_t t = 0; t < tiles_.size(); ++t) cast_tile(views, tiles_[t], lists[t], hits);
  cv::Mat radiance(size, CV_32FC1, cv::Scalar(0));
  for (std::size_t t = 0; t < tiles_.size(); ++t)
    shade_tile(views, tiles_[t], lists[t], hits, radiance);
  return {radiance, hits.depth};
}

Vector2f Renderer::image_motion(const Vector2f* b, float depth, const CameraMotion& motion) const {
  // A resting point in cam moves with -v - w x X; divided by its depth.
  const Vector3f rate = -motion.velocity_cam / depth - motion.rate_cam.cross(b->homogeneous());
  const Vector2f flow = rate.head<2>() - *b * rate.z();
  // Bearings to pixels by the local shape of the distorted image.
  const Vector2f right = b[1] - b[0], down = b[stride()] - b[0];
  const float inverse_area = 1.0f / (right.x() * down.y() - right.y() * down.x());
  return inverse_area * Vector2f(flow.x() * down.y() - flow.y() * down.x(),
                                 flow.y() * right.x() - flow.x() * right.y());
}

cv::Mat Renderer::blur_by_motion(const Rendering& sharp, const CameraMotion& motion,
                                 const TemporalResponse& response) const {
  const bool shutter = response.shape == TemporalResponse::Shape::kShutter;
  const float visible = shutter ? 0.35f : 0.1f;  // px; shorter paths blur less than the lens does
  const std::vector<Looks> table = looks_by_path(response.shape);
  const float duration = static_cast<float>(response.duration_s);
  cv::Mat blurred(sharp.radiance.size(), CV_32FC1, cv::Scalar(0));
  for (int y = 0; y < camera_.height; ++y)
    for (int x = 0; x < camera_.width; ++x) {
      if (!is_lit(x, y)) continue;
      const Vector2f path =
          duration * image_motion(bearing(x, y), sharp.depth.at<float>(y, x), motion);
      const float length = path.norm();
      float& out = blurred.at<float>(y, x);
      if (length < visible) {
        out = sharp.radiance.at<float>(y, x);
        continue;
      }
      const auto row = std::min(kLongestPath, static_cast<std::size_t>(length));
      out = 0;
      // At an instant before the stamp the pixel saw what has moved on along its path since.
      for (const Look& look : table[row])
        out +=
            look.weight * bilinear(sharp.radiance, static_cast<float>(x) - look.instant * path.x(),
                                   static_cast<float>(y) - look.instant * path.y());
    }
  return blurred;
}

}  // namespace covey
