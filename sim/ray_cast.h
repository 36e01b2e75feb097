// SPDX-License-Identifier: Apache-2.0
//
// One camera position looking at a scene: where a ray ends and what it sees there. Single precision
// throughout: 1e-5 m at 100 m is a ten-thousandth of a pixel.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/scene.h"

namespace covey {

struct Hit {
  float depth = 1e6f;  // along the ray, in units of its direction's length
  int surface = -1;    // primitive * 8 + face; -1 is the sky
};

struct Candidate {
  float near_depth = 0;  // no point of the primitive is closer
  int primitive = 0;
};

// Where a ray meets a primitive, and in which of its faces.
struct Crossing {
  float depth = 1e6f;
  int face = 0;
};

// A point of a primitive's surface, in the primitive's own axes.
struct SurfacePoint {
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();
  Eigen::Vector3f tangent_u = Eigen::Vector3f::UnitX();  // where u grows, and v
  Eigen::Vector3f tangent_v = Eigen::Vector3f::UnitY();
  float u = 0, v = 0;  // m along the surface
};

class RayCaster {
 public:
  RayCaster(const Scene& scene, const Eigen::Vector3f& p_world_cam);

  // First surface along `direction` (world frame, z = 1 in cam). Candidates come nearest first.
  [[nodiscard]] Hit cast(const Eigen::Vector3f& direction, const Candidate* begin,
                         const Candidate* end) const;

  // What a pixel of the given angular width sees there: radiance, or temperature (Scene::lighting).
  [[nodiscard]] float shade(const Eigen::Vector3f& direction, const Hit& hit,
                            float pixel_angle) const;

 private:
  struct Local {  // a primitive with the camera's position in its own axes
    Shape shape;
    Eigen::Vector3f origin, half, inverse_half;
    float cosine, sine;
  };

  [[nodiscard]] static Crossing cross(const Local& local, const Eigen::Vector3f& d);
  [[nodiscard]] static SurfacePoint surface_at(const Local& local, const Eigen::Vector3f& p_local,
                                               int face);
  [[nodiscard]] float light_on(const Local& local, const SurfacePoint& surface,
                               const Eigen::Vector3f& p_local) const;  // 0..1
  [[nodiscard]] float sky(const Eigen::Vector3f& direction, float pixel_angle) const;

  const Scene& scene_;
  Eigen::Vector3f p_world_cam_;
  std::vector<Local> locals_;
};

}  // namespace covey
