// SPDX-License-Identifier: Apache-2.0
#include "sim/scene.h"

#include <algorithm>
#include <cmath>

#include "sim/random.h"

namespace covey {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

enum Stream : std::uint64_t { kCastleStream = 101, kYardStream, kRoomStream };

// Random numbers are drawn in named statements or in braces: their order is then the same with
// every compiler, which the arguments of a function do not promise.
class SceneBuilder {
 public:
  SceneBuilder(Scene& scene, Random& random) : scene_(scene), random_(random) {}

  float uniform(double low, double high) { return static_cast<float>(random_.uniform(low, high)); }

  float any_angle() { return uniform(0, 2 * M_PI); }

  int material(const Material& material) {
    scene_.materials.push_back(material);
    return static_cast<int>(scene_.materials.size()) - 1;
  }

  void add(Shape shape, const Vector3f& center, const Vector3f& half, int material, float yaw = 0) {
    Primitive p{shape, center, half, yaw, material, {uniform(0, 1000), uniform(0, 1000)}};
    scene_.primitives.push_back(p);
  }

  // Boxes and towers are given by where they stand.
  void box(const Vector2f& xy, float bottom, const Vector3f& size, int material, float yaw = 0) {
    add(Shape::kBox, {xy.x(), xy.y(), bottom + size.z() / 2}, size / 2, material, yaw);
  }
  void tower(const Vector2f& xy, float bottom, float height, float radius_bottom, float radius_top,
             int material) {
    add(Shape::kFrustum, {xy.x(), xy.y(), bottom + height / 2},
        {radius_bottom, radius_top, height / 2}, material, any_angle());
  }

  // Somewhere in a ring around the origin.
  Vector2f in_ring(double inner, double outer) {
    const double radius = std::sqrt(random_.uniform(inner * inner, outer * outer));
    const double angle = random_.uniform(0, 2 * M_PI);
    return {static_cast<float>(radius * std::cos(angle)),
            static_cast<float>(radius * std::sin(angle))};
  }

  // A rock that sits in the ground.
  void rock(const Vector2f& xy, float size, int material) {
    const Vector3f half{size * uniform(0.7, 1.3), size * uniform(0.7, 1.3),
                        size * uniform(0.5, 1.0)};
    const float middle = half.z() * uniform(-0.3, 0.3);
    add(Shape::kEllipsoid, {xy.x(), xy.y(), middle}, half, material, any_angle());
  }

 private:
  Scene& scene_;
  Random& random_;
};

std::shared_ptr<const Texture> share(Texture texture) {
  return std::make_shared<const Texture>(std::move(texture));
}

std::shared_ptr<const Texture> soft_noise(std::uint64_t seed) {
  return share(make_soft_noise({512, 0.08f, seed}));
}

struct CastleMaterials {
  int wall, plaster, roof, grass, leaves, hills;
};

// Merlons along the upper edge of a wall from `a` to `b`.
void battlement(SceneBuilder& build, const Vector2f& a, const Vector2f& b, float height,
                int material) {
  const float length = (b - a).norm(), yaw = std::atan2(b.y() - a.y(), b.x() - a.x());
  const int count = static_cast<int>(length / 1.7f);
  for (int i = 0; i < count; ++i) {
    const Vector2f at = a + (b - a) * ((static_cast<float>(i) + 0.5f) / static_cast<float>(count));
    build.box(at, height, {0.95f, 0.6f, build.uniform(0.8, 1.0)}, material, yaw);
  }
}

void corner_tower(SceneBuilder& build, const Vector2f& at, const CastleMaterials& m) {
  const float height = build.uniform(11, 14.5), radius = build.uniform(2.7, 3.1);
  build.tower(at, 0, height, radius, radius * 0.93f, m.wall);
  build.tower(at, height, 0.5f, radius * 1.08f, radius * 1.08f, m.plaster);
  build.tower(at, height + 0.5f, build.uniform(3.5, 5), radius * 1.1f, 0.0f, m.roof);
}

// Four curtain walls, 30 m long, with a facade of buttresses and bays on every side.
void curtain_walls(SceneBuilder& build, const CastleMaterials& m) {
  constexpr float kHalf = 14.2f, kThick = 1.6f;
  for (int side = 0; side < 4; ++side) {
    const float yaw = static_cast<float>(M_PI / 2) * static_cast<float>(side);
    const float c = std::cos(yaw), s = std::sin(yaw);
    const auto place = [c, s](float along, float out) {
      return Vector2f(c * along + s * out, s * along - c * out);
    };
    const float height = build.uniform(7.5, 9);
    build.box(place(0, kHalf), 0, {26, kThick, height}, m.wall, yaw);
    build.box(place(0, kHalf + 0.15f), height - 0.9f, {26, kThick + 0.3f, 0.35f}, m.plaster, yaw);
    battlement(build, place(-12, kHalf + 0.5f), place(12, kHalf + 0.5f), height, m.wall);
    float along = -10.5f;
    while (along < 10.6f) {
      if (build.uniform(0, 1) < 0.4f)
        build.box(place(along, kHalf + 1.1f), 0, {1.6f, 1.2f, height * build.uniform(0.5, 0.95)},
                  m.plaster, yaw);
      else
        build.box(place(along, kHalf + 0.95f), build.uniform(2.2, 4), {1.8f, 0.7f, 2.2f}, m.wall,
                  yaw);
      along += build.uniform(3.2, 5.4);
    }
  }
}

void keep(SceneBuilder& build, const CastleMaterials& m) {
  const float height = build.uniform(15, 18);
  build.box({0, 0}, 0, {12, 12, height}, m.wall);
  for (int i = 0; i < 4; ++i) {
    const float x = (i & 1) ? 6.0f : -6.0f, y = (i & 2) ? 6.0f : -6.0f;
    const float top = height + build.uniform(1, 3);
    build.tower({x, y}, 0, top, 1.5f, 1.5f, m.plaster);
    build.tower({x, y}, top, 2.6f, 1.7f, 0.0f, m.roof);
  }
  battlement(build, {-5, -5.8f}, {5, -5.8f}, height, m.plaster);
  battlement(build, {-5, 5.8f}, {5, 5.8f}, height, m.plaster);
  battlement(build, {-5.8f, -5}, {-5.8f, 5}, height, m.plaster);
  battlement(build, {5.8f, -5}, {5.8f, 5}, height, m.plaster);
  build.tower({0, 0}, height, 5, 2.2f, 2.0f, m.wall);
  build.tower({0, 0}, height + 5, 4, 2.4f, 0.0f, m.roof);
}

// Low things where the drones fly, houses and trees beyond.
void castle_surroundings(SceneBuilder& build, const CastleMaterials& m) {
  for (int i = 0; i < 130; ++i) {
    const Vector2f at = build.in_ring(18.5, 55);
    build.rock(at, build.uniform(0.2, 1.0), i < 90 ? m.wall : m.leaves);
  }
  for (int i = 0; i < 14; ++i) {
    const float yaw = build.uniform(0, 3.14), height = build.uniform(3.5, 7);
    const Vector2f at = build.in_ring(62, 100);
    build.box(at, 0, {build.uniform(6, 14), build.uniform(5, 9), height}, m.plaster, yaw);
    build.box(at, height, {build.uniform(4, 7), build.uniform(3, 5), 1.8f}, m.roof, yaw);
  }
  for (int i = 0; i < 60; ++i) {
    const Vector2f at = build.in_ring(60, 130);
    const float radius = build.uniform(2, 4.5), height = build.uniform(4, 9);
    build.tower(at, 0, height, 0.45f, 0.3f, m.roof);
    build.add(Shape::kEllipsoid, {at.x(), at.y(), height}, {radius, radius, radius * 1.2f},
              m.leaves);
  }
}

// One material of stony ground, one of rocks: temperatures in K around Scene::ambient.
struct YardMaterials {
  int sand, rock;
};

void yard_rocks(SceneBuilder& build, const YardMaterials& m) {
  for (int i = 0; i < 900; ++i) {
    const float size = std::min(0.05f * std::pow(build.uniform(0.02, 1.0), -0.6f), 0.5f);
    const Vector2f at = build.in_ring(0, 12);  // few large ones, many small
    if (build.uniform(0, 1) < 0.65f) {
      build.rock(at, size, m.rock);
      continue;
    }
    const Vector3f block{size * build.uniform(0.8, 2.2), size * build.uniform(0.8, 1.6),
                         size * build.uniform(0.5, 1.1)};
    build.box(at, -0.2f * size, block, m.rock, build.any_angle());
  }
  for (int i = 0; i < 30; ++i) {  // gentle mounds
    const Vector2f at = build.in_ring(1, 16);
    const float radius = build.uniform(0.8, 2.2);
    const Vector3f half{radius, radius * build.uniform(0.6, 1), 0.5f + build.uniform(0.08, 0.3)};
    build.add(Shape::kEllipsoid, {at.x(), at.y(), -0.5f}, half, m.sand, build.any_angle());
  }
}

struct RoomBounds {
  Vector3f low, high;  // the walls
};

void furniture(SceneBuilder& build, const RoomBounds& room, float clear_height, float wall_margin,
               int material) {
  const Vector3f size = room.high - room.low;
  const int count = 10 + static_cast<int>(0.5f * (size.x() + size.y()));
  for (int i = 0; i < count; ++i) {
    const bool along_x = build.uniform(0, size.x() + size.y()) < size.x();
    const float depth = build.uniform(0.25, std::max(0.3f, 0.7f * wall_margin));
    const float width = build.uniform(0.4, 1.8), height = build.uniform(0.4, 0.75 * size.z());
    const bool low_side = build.uniform(0, 1) < 0.5f;
    const float along = build.uniform(0.05, 0.95);
    const float x =
        room.low.x() + (along_x ? along * size.x() : (low_side ? depth / 2 : size.x() - depth / 2));
    const float y =
        room.low.y() + (along_x ? (low_side ? depth / 2 : size.y() - depth / 2) : along * size.y());
    build.box({x, y}, room.low.z(),
              along_x ? Vector3f(width, depth, height) : Vector3f(depth, width, height), material);
  }
  for (int i = 0; i < count; ++i) {  // low crates anywhere below the drones
    const float height = build.uniform(0.15, std::max(0.2f, 0.8f * clear_height));
    const Vector2f at{build.uniform(room.low.x() + 0.5, room.high.x() - 0.5),
                      build.uniform(room.low.y() + 0.5, room.high.y() - 0.5)};
    const Vector3f crate{build.uniform(0.25, 0.9), build.uniform(0.25, 0.9), height};
    build.box(at, room.low.z(), crate, material, build.any_angle());
  }
}

}  // namespace

float material_texture(const Material& material, const Vector2f& uv, Footprint footprint) {
  footprint.minor *= material.scale;
  footprint.major *= material.scale;
  const float content = material.content->sample(uv.x(), uv.y(), footprint);
  // Turned by an angle and scaled by a ratio without short common periods with the content.
  constexpr float kCosine = 0.3010f, kSine = 0.2237f, kScale = 0.375f;
  const float stain =
      material.stain->sample(kCosine * uv.x() + kSine * uv.y(), kCosine * uv.y() - kSine * uv.x(),
                             kScale * 0.5f * (footprint.minor + footprint.major));
  return content * (1.0f + material.stain_depth * (2.0f * stain - 1.0f));
}

Scene make_castle(const SceneOptions& options) {
  Random random(options.seed, kCastleStream);
  Scene scene;
  scene.light = Vector3f(0.45f, -0.62f, 0.64f).normalized();
  scene.ambient = 0.55f;
  scene.light_gain = 0.55f;
  SceneBuilder build(scene, random);
  const auto masonry = share(make_masonry({options.texture_size, 0.01f, options.seed * 4 + 1}));
  const auto patches = share(make_patches({options.texture_size, 0.01f, options.seed * 4 + 2}));
  const auto noise = soft_noise(options.seed * 4 + 3);
  scene.sky = noise;
  CastleMaterials m{};
  m.wall = build.material({masonry, noise, 1.0f, 1.0f, 0.35f});
  m.plaster = build.material({patches, noise, 1.6f, 1.05f, 0.3f});
  m.roof = build.material({masonry, noise, 1.7f, 0.6f, 0.4f});
  m.grass = build.material({patches, noise, 0.83f, 0.85f, 0.5f});
  m.leaves = build.material({patches, noise, 1.3f, 0.5f, 0.5f});
  m.hills = build.material({patches, noise, 0.08f, 0.7f, 0.3f});

  build.add(Shape::kGround, Vector3f::Zero(), Vector3f::Ones(), m.grass);
  build.add(Shape::kSkyline, Vector3f::Zero(), {220, 220, 16}, m.hills);
  keep(build, m);
  curtain_walls(build, m);
  for (const Vector2f& at : {Vector2f(-13.2f, -13.2f), Vector2f(13.2f, -13.2f),
                             Vector2f(-13.2f, 13.2f), Vector2f(13.2f, 13.2f)})
    corner_tower(build, at, m);
  castle_surroundings(build, m);
  return scene;
}

Scene make_mars_yard(const SceneOptions& options) {
  Random random(options.seed, kYardStream);
  Scene scene;
  scene.lighting = Lighting::kThermal;
  scene.light = Vector3f(0.6f, 0.35f, 0.72f).normalized();
  scene.ambient = 294.0f;   // K; sand in the shade
  scene.light_gain = 3.5f;  // K; how much warmer the sun has made what faces it
  SceneBuilder build(scene, random);
  const auto patches = share(make_soil({options.texture_size, 0.008f, options.seed * 4 + 1}));
  const auto noise = soft_noise(options.seed * 4 + 3);
  YardMaterials m{};
  m.sand = build.material({patches, noise, 1.0f, 3.0f, 1.2f});
  m.rock = build.material({patches, noise, 1.4f, 5.0f, 0.6f});
  build.add(Shape::kGround, Vector3f::Zero(), Vector3f::Ones(), m.sand);
  build.add(Shape::kSkyline, Vector3f::Zero(), {60, 60, 5}, m.rock);
  yard_rocks(build, m);
  return scene;
}

Scene make_room(const SceneOptions& options, const Eigen::Vector3d& low,
                const Eigen::Vector3d& high) {
  Random random(options.seed, kRoomStream);
  Scene scene;
  scene.lighting = Lighting::kLamp;
  scene.ambient = 0.5f;
  scene.light_gain = 0.7f;
  SceneBuilder build(scene, random);
  const float margin = build.uniform(1.5, 2.5), below = build.uniform(0.7, 1.1);
  const RoomBounds room{low.cast<float>() - Vector3f(margin, margin, below),
                        high.cast<float>() + Vector3f(margin, margin, build.uniform(1.0, 1.6))};
  const Vector3f middle = 0.5f * (room.low + room.high);
  scene.light = {middle.x(), middle.y(), room.high.z() - 0.1f};

  const auto patches = share(make_patches({options.texture_size, 0.008f, options.seed * 4 + 1}));
  const auto masonry = share(make_masonry({options.texture_size, 0.008f, options.seed * 4 + 2}));
  const auto noise = soft_noise(options.seed * 4 + 3);
  const int walls = build.material({patches, noise, 1.0f, 0.95f, 0.4f});
  const int things = build.material({patches, noise, 1.9f, 1.0f, 0.4f});
  const int bricks = build.material({masonry, noise, 1.8f, 0.9f, 0.4f});
  build.add(Shape::kRoom, middle, 0.5f * (room.high - room.low), walls);
  furniture(build, room, below, margin, things);
  furniture(build, room, below, margin, bricks);
  return scene;
}

}  // namespace covey
