// SPDX-License-Identifier: Apache-2.0
//
// A scene is a list of analytic shapes with procedural textures: exact depth, exact edges, no
// meshes to load. World frame: z up, metres, ground at z = 0 outdoors.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/texture.h"

namespace covey {

enum class Shape : std::uint8_t {
  kGround,     // the plane z = center.z, without end
  kBox,        // half extents, turned by yaw
  kEllipsoid,  // semi-axes, turned by yaw
  kFrustum,    // half.x = radius at the bottom, half.y = at the top, half.z = half the height
  kRoom,       // a box seen from inside: walls, floor and ceiling
  kSkyline,    // a ring of hills of radius half.x and mean height half.z around center, seen from
               // inside
};

struct Material {
  std::shared_ptr<const Texture> content;  // edges and corners
  std::shared_ptr<const Texture> stain;    // slow variation, sampled turned and at another scale
  float scale = 1.0f;                      // texture metres for a metre of the surface
  float brightness = 1.0f;                 // visual: albedo for white; thermal: K for white
  float stain_depth = 0.5f;                // 0 none .. 1 full
};

struct Primitive {
  Shape shape = Shape::kBox;
  Eigen::Vector3f center = Eigen::Vector3f::Zero();  // m
  Eigen::Vector3f half = Eigen::Vector3f::Ones();    // m, see Shape
  float yaw = 0;                                     // rad, about z
  int material = 0;
  Eigen::Vector2f texture_offset =
      Eigen::Vector2f::Zero();  // m, so that no two surfaces look alike
};

// Grey level in [0, 1] (a little beyond for extreme stains) of a material at texture coordinates
// `uv`, m, over a footprint given in metres of the surface.
[[nodiscard]] float material_texture(const Material& material, const Eigen::Vector2f& uv,
                                     Footprint footprint);

// How the surfaces turn into what a pixel measures.
enum class Lighting : std::uint8_t {
  kSun,   // radiance, 1 = white paper in the sun; ambient light, sun from `light`, sky with clouds
  kLamp,  // radiance; one lamp at the point `light`
  kThermal,  // temperature in K: `ambient` plus texture plus heating by the sun
};

struct Scene {
  Lighting lighting = Lighting::kSun;
  Eigen::Vector3f light = Eigen::Vector3f(0.5f, -0.4f, 0.77f);  // unit direction, or a point in m
  float ambient = 0.4f;     // radiance of white paper in the shade, or K
  float light_gain = 0.6f;  // radiance (or K) that the light adds at normal incidence
  std::vector<Material> materials;
  std::vector<Primitive> primitives;
  std::shared_ptr<const Texture> sky;  // clouds; none indoors
};

struct SceneOptions {
  std::uint64_t seed = 1;
  int texture_size = 4096;  // texels; smaller for quick tests, then the textures repeat sooner
};

// About 30 m wide around the origin; free air from 19 m outwards above 3 m up to 60 m.
[[nodiscard]] Scene make_castle(const SceneOptions& options);
// A rocky yard for the thermal camera; lowest flight 1.2 m above z = 0.
[[nodiscard]] Scene make_mars_yard(const SceneOptions& options);
// A furnished room; nothing but air between `low` and `high` (the bounding box of the motion, m).
[[nodiscard]] Scene make_room(const SceneOptions& options, const Eigen::Vector3d& low,
                              const Eigen::Vector3d& high);

}  // namespace covey
