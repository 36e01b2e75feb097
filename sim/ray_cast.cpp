// SPDX-License-Identifier: Apache-2.0
#include "sim/ray_cast.h"

#include <algorithm>
#include <cmath>

namespace covey {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr float kNear = 0.02f;  // m; nothing closer is seen
constexpr float kNoHit = 1e6f;
constexpr float kGrazing = 0.03f;  // least cosine of incidence used for the footprint

Vector3f to_local(const Vector3f& v, float cosine, float sine) {
  return {cosine * v.x() + sine * v.y(), cosine * v.y() - sine * v.x(), v.z()};
}

struct Slabs {
  float enter, leave;
  int enter_face, leave_face;  // axis * 2 + (1 on the positive side)
};

Slabs intersect_slabs(const Vector3f& origin, const Vector3f& d, const Vector3f& half) {
  Slabs slabs{-kNoHit, kNoHit, 0, 0};
  for (int axis = 0; axis < 3; ++axis) {
    const float inverse = 1.0f / (std::abs(d[axis]) > 1e-9f ? d[axis] : 1e-9f);
    const float low = (-half[axis] - origin[axis]) * inverse;
    const float high = (half[axis] - origin[axis]) * inverse;
    const bool forward = inverse > 0;
    const float enter = forward ? low : high, leave = forward ? high : low;
    if (enter > slabs.enter) slabs.enter = enter, slabs.enter_face = axis * 2 + (forward ? 0 : 1);
    if (leave < slabs.leave) slabs.leave = leave, slabs.leave_face = axis * 2 + (forward ? 1 : 0);
  }
  return slabs;
}

float intersect_ellipsoid(const Vector3f& origin, const Vector3f& d, const Vector3f& inverse_half) {
  const Vector3f o = origin.cwiseProduct(inverse_half), e = d.cwiseProduct(inverse_half);
  const float a = e.squaredNorm(), b = o.dot(e);
  const float discriminant = b * b - a * (o.squaredNorm() - 1.0f);
  if (discriminant <= 0) return kNoHit;
  const float depth = (-b - std::sqrt(discriminant)) / a;
  return depth > kNear ? depth : kNoHit;
}

// The mantle (face 0) is the cone x2 + y2 = (m + k z)2; the lid (face 1) lies at z = +half.z.
Crossing intersect_frustum(const Vector3f& o, const Vector3f& d, const Vector3f& half) {
  const float mean = 0.5f * (half.x() + half.y());
  const float slope = 0.5f * (half.y() - half.x()) / half.z();
  Crossing best{kNoHit, 0};
  const float at_origin = mean + slope * o.z();
  const float a = d.x() * d.x() + d.y() * d.y() - slope * slope * d.z() * d.z();
  const float b = o.x() * d.x() + o.y() * d.y() - slope * d.z() * at_origin;
  const float c = o.x() * o.x() + o.y() * o.y() - at_origin * at_origin;
  const float discriminant = b * b - a * c;
  if (discriminant > 0 && std::abs(a) > 1e-9f) {
    const float root = std::sqrt(discriminant);
    for (const float depth : {(-b - root) / a, (-b + root) / a}) {
      const float z = o.z() + depth * d.z();
      const bool on_mantle = std::abs(z) <= half.z() && mean + slope * z >= 0;
      if (on_mantle && depth > kNear && depth < best.depth) best = {depth, 0};
    }
  }
  const float lid = (half.z() - o.z()) / (std::abs(d.z()) > 1e-9f ? d.z() : 1e-9f);
  const float x = o.x() + lid * d.x(), y = o.y() + lid * d.y();
  if (lid > kNear && lid < best.depth && x * x + y * y < half.y() * half.y()) best = {lid, 1};
  return best;
}

float skyline_height(const Vector3f& half, float angle) {
  return half.z() * (1.0f + 0.4f * std::sin(3 * angle + 0.7f) + 0.25f * std::sin(8 * angle + 2.1f) +
                     0.12f * std::sin(23 * angle));
}

float intersect_skyline(const Vector3f& o, const Vector3f& d, const Vector3f& half) {
  const float a = d.x() * d.x() + d.y() * d.y(), b = o.x() * d.x() + o.y() * d.y();
  const float c = o.x() * o.x() + o.y() * o.y() - half.x() * half.x();
  const float depth = (-b + std::sqrt(std::max(0.0f, b * b - a * c))) / std::max(a, 1e-9f);
  const float z = o.z() + depth * d.z();
  if (z > 1.8f * half.z() || depth <= kNear) return kNoHit;
  const float angle = std::atan2(o.y() + depth * d.y(), o.x() + depth * d.x());
  return z < skyline_height(half, angle) ? depth : kNoHit;
}

SurfacePoint flat_surface(const Vector3f& p, int axis, float sign) {
  const int u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  return {sign * Vector3f::Unit(axis), Vector3f::Unit(u), Vector3f::Unit(v), p[u], p[v]};
}

// The texture is projected along the axis that the surface faces most.
SurfacePoint ellipsoid_surface(const Vector3f& p, const Vector3f& inverse_half) {
  const Vector3f normal = p.cwiseProduct(inverse_half).cwiseProduct(inverse_half).normalized();
  int axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  SurfacePoint s = flat_surface(p, axis, 1.0f);
  s.normal = normal;
  return s;
}

// The texture is wrapped around: u follows the circumference at mean radius, v the height.
SurfacePoint round_surface(const Vector3f& p, float mean_radius, float slope) {
  const float radius = std::max(1e-6f, std::sqrt(p.x() * p.x() + p.y() * p.y()));
  const float c = p.x() / radius, s = p.y() / radius;
  return {Vector3f(c, s, -slope).normalized(), Vector3f(-s, c, 0) * (mean_radius / radius),
          Vector3f::UnitZ(), mean_radius * std::atan2(p.y(), p.x()), p.z()};
}

// The pixel's width of view, `angular_width` times the ray's length, laid on the surface.
Footprint footprint_on(const SurfacePoint& surface, const Vector3f& d, float angular_width) {
  const float length = d.norm();
  const float cosine = std::max(kGrazing, std::abs(surface.normal.dot(d)) / length);
  const Vector2f along(surface.tangent_u.dot(d), surface.tangent_v.dot(d));
  const Vector2f major = along / std::max(1e-6f, along.norm());
  return {angular_width * length, angular_width * length / cosine, major.x(), major.y()};
}

}  // namespace

RayCaster::RayCaster(const Scene& scene, const Vector3f& p_world_cam)
    : scene_(scene), p_world_cam_(p_world_cam) {
  locals_.reserve(scene.primitives.size());
  for (const Primitive& p : scene.primitives) {
    const float cosine = std::cos(p.yaw), sine = std::sin(p.yaw);
    locals_.push_back({p.shape, to_local(p_world_cam - p.center, cosine, sine), p.half,
                       p.half.cwiseInverse(), cosine, sine});
  }
}

Crossing RayCaster::cross(const Local& local, const Vector3f& d) {
  switch (local.shape) {
    case Shape::kGround:
      return {d.z() < -1e-6f ? -local.origin.z() / d.z() : kNoHit, 5};
    case Shape::kBox: {
      const Slabs slabs = intersect_slabs(local.origin, d, local.half);
      return {slabs.enter <= slabs.leave ? slabs.enter : kNoHit, slabs.enter_face};
    }
    case Shape::kRoom: {
      const Slabs slabs = intersect_slabs(local.origin, d, local.half);
      return {slabs.leave, slabs.leave_face};
    }
    case Shape::kEllipsoid:
      return {intersect_ellipsoid(local.origin, d, local.inverse_half), 0};
    case Shape::kFrustum:
      return intersect_frustum(local.origin, d, local.half);
    case Shape::kSkyline:
      return {intersect_skyline(local.origin, d, local.half), 0};
  }
  return {};
}

Hit RayCaster::cast(const Vector3f& direction, const Candidate* begin, const Candidate* end) const {
  Hit best;
  for (const Candidate* c = begin; c != end && c->near_depth < best.depth; ++c) {
    const Local& local = locals_[static_cast<std::size_t>(c->primitive)];
    const Crossing crossing = cross(local, to_local(direction, local.cosine, local.sine));
    if (crossing.depth > kNear && crossing.depth < best.depth)
      best = {crossing.depth, c->primitive * 8 + crossing.face};
  }
  return best;
}

SurfacePoint RayCaster::surface_at(const Local& local, const Vector3f& p, int face) {
  switch (local.shape) {
    case Shape::kGround:
    case Shape::kBox:
      return flat_surface(p, face / 2, face % 2 == 1 ? 1.0f : -1.0f);
    case Shape::kRoom:
      return flat_surface(p, face / 2, face % 2 == 1 ? -1.0f : 1.0f);
    case Shape::kEllipsoid:
      return ellipsoid_surface(p, local.inverse_half);
    case Shape::kFrustum:
      if (face == 1) return flat_surface(p, 2, 1.0f);
      return round_surface(p, 0.5f * (local.half.x() + local.half.y()),
                           0.5f * (local.half.y() - local.half.x()) / local.half.z());
    case Shape::kSkyline: {
      SurfacePoint s = round_surface(p, local.half.x(), 0);
      s.normal = -s.normal;
      return s;
    }
  }
  return {};
}

float RayCaster::sky(const Vector3f& direction, float pixel_angle) const {
  constexpr float kColder = 20.0f;  // K, a hazy sky against the ground in the shade
  if (scene_.lighting == Lighting::kThermal) return scene_.ambient - kColder;
  if (!scene_.sky) return scene_.ambient;
  const Vector3f d = direction.normalized();
  // Clouds lie on a plane far above; near the horizon they get flatter and paler.
  const float height = std::max(0.0f, d.z()) + 0.12f, contrast = 0.35f * std::min(1.0f, 2 * height);
  const float cloud = scene_.sky->sample(10.0f * d.x() / height, 10.0f * d.y() / height,
                                         10.0f * pixel_angle / (height * height));
  return 0.8f - 0.15f * std::min(1.0f, height) + contrast * (cloud - 0.5f);
}

float RayCaster::light_on(const Local& local, const SurfacePoint& surface,
                          const Vector3f& p_local) const {
  if (scene_.lighting != Lighting::kLamp)
    return std::max(0.0f, surface.normal.dot(to_local(scene_.light, local.cosine, local.sine)));
  constexpr float kHalfLight2 = 12.0f;  // m2, where the lamp gives half its light
  const Vector3f to_lamp =
      local.origin + to_local(scene_.light - p_world_cam_, local.cosine, local.sine) - p_local;
  const float distance2 = to_lamp.squaredNorm();
  const float cosine = std::max(0.0f, surface.normal.dot(to_lamp) / std::sqrt(distance2));
  return cosine * kHalfLight2 / (kHalfLight2 + distance2);
}

float RayCaster::shade(const Vector3f& direction, const Hit& hit, float pixel_angle) const {
  if (hit.surface < 0) return sky(direction, pixel_angle);
  const auto index = static_cast<std::size_t>(hit.surface / 8);
  const Local& local = locals_[index];
  const Primitive& primitive = scene_.primitives[index];
  const Material& material = scene_.materials[static_cast<std::size_t>(primitive.material)];

  const Vector3f d = to_local(direction, local.cosine, local.sine);
  const Vector3f p_local = local.origin + hit.depth * d;
  const SurfacePoint surface = surface_at(local, p_local, hit.surface % 8);
  const Vector2f uv(surface.u, surface.v);
  // Faces of one primitive show different parts of the texture.
  const Vector2f shift = static_cast<float>(hit.surface % 8) * Vector2f(7.31f, 3.17f);
  const float texture =
      material_texture(material, uv * material.scale + primitive.texture_offset + shift,
                       footprint_on(surface, d, hit.depth * pixel_angle));
  const float light = light_on(local, surface, p_local);
  if (scene_.lighting == Lighting::kThermal)
    return scene_.ambient + material.brightness * (texture - 0.5f) + scene_.light_gain * light;
  return material.brightness * texture * (scene_.ambient + scene_.light_gain * light);
}

}  // namespace covey
