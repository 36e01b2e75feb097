// SPDX-License-Identifier: Apache-2.0
#include "sim/landmark_world.h"

#include <algorithm>
#include <array>

#include "sim/random.h"

namespace covey {
namespace {

struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9);
  Eigen::Vector3d high = Eigen::Vector3d::Constant(-1e9);
};

constexpr double kStep_s = 0.25;  // between looks at where a flight is

Box flown_box(const std::vector<DronePlan>& flights) {
  Box box;
  for (const DronePlan& plan : flights) {
    const int steps = static_cast<int>(plan.trajectory.duration_s() / kStep_s);
    for (int k = 0; k <= steps; ++k) {
      const Eigen::Vector3d p = plan.trajectory.pose_at(k * kStep_s).p_world_imu;
      box.low = box.low.cwiseMin(p);
      box.high = box.high.cwiseMax(p);
    }
  }
  return box;
}

Eigen::Vector3d inside(Random& random, const Box& box) {
  const double x = random.uniform(box.low.x(), box.high.x());
  const double y = random.uniform(box.low.y(), box.high.y());
  const double z = random.uniform(box.low.z(), box.high.z());
  return {x, y, z};
}

// A point on one of the six faces, chosen by area, up to `relief_m` in front of it.
SurfaceLandmark on_inner_wall(Random& random, const Box& box, double relief_m) {
  const Eigen::Vector3d size = box.high - box.low;
  const std::array<double, 3> area{size.y() * size.z(), size.x() * size.z(), size.x() * size.y()};
  double pick = random.unit() * (area[0] + area[1] + area[2]);
  int axis = 0;
  while (axis < 2 && pick >= area[static_cast<std::size_t>(axis)]) {
    pick -= area[static_cast<std::size_t>(axis++)];
  }
  SurfaceLandmark landmark;
  landmark.p_world = inside(random, box);
  const bool upper = random.unit() < 0.5;
  const double relief = random.uniform(0, relief_m);
  landmark.p_world[axis] = upper ? box.high[axis] - relief : box.low[axis] + relief;
  landmark.normal_world = (upper ? -1.0 : 1.0) * Eigen::Vector3d::Unit(axis);
  return landmark;
}

// Four facades, 30 m wide and 14 m high, with bays; or the ground around them.
SurfaceLandmark castle_or_ground(Random& random) {
  constexpr double kHalfWidth = 15, kHeight = 14, kBay = 1.5, kGround = 35;  // m
  SurfaceLandmark landmark;
  if (random.unit() < 0.3) {
    do {
      landmark.p_world = inside(random, {{-kGround, -kGround, 0}, {kGround, kGround, 0.3}});
    } while (landmark.p_world.head<2>().cwiseAbs().maxCoeff() < kHalfWidth);
    return landmark;
  }
  const int side = static_cast<int>(random.index(4));
  const double sign = side % 2 == 0 ? 1 : -1;
  const Eigen::Index out = side / 2, along = 1 - out;
  landmark.normal_world = sign * Eigen::Vector3d::Unit(out);
  landmark.p_world[out] = sign * (kHalfWidth - random.uniform(0, kBay));
  landmark.p_world[along] = random.uniform(-kHalfWidth, kHalfWidth);
  landmark.p_world.z() = random.uniform(0, kHeight);
  return landmark;
}

SurfaceLandmark on_rocky_ground(Random& random, const Box& flown) {
  constexpr double kMargin = 4, kRock = 0.4;  // m
  Box ground = flown;
  ground.low.array() -= kMargin;
  ground.high.array() += kMargin;
  ground.low.z() = 0;
  ground.high.z() = kRock;
  return {inside(random, ground), Eigen::Vector3d::UnitZ()};
}

Box room_around(Box flown) {
  constexpr double kMargin = 2.2;  // m
  flown.low.array() -= kMargin;
  flown.high.array() += kMargin;
  return flown;
}

}  // namespace

std::vector<SurfaceLandmark> landmark_world(Scenario scenario,
                                            const std::vector<DronePlan>& flights, int count,
                                            std::uint64_t seed) {
  Random random(seed, 0x3a9d);
  const Box flown = flown_box(flights);
  const bool castle = scenario == Scenario::kCastleAround || scenario == Scenario::kCastleParallel;
  const int enough = castle ? 2400 : 2500;
  const Box walls = room_around(flown);
  std::vector<SurfaceLandmark> landmarks(static_cast<std::size_t>(count > 0 ? count : enough));
  for (SurfaceLandmark& landmark : landmarks) {
    if (castle) {
      landmark = castle_or_ground(random);
    } else if (scenario == Scenario::kMarsYard) {
      landmark = on_rocky_ground(random, flown);
    } else {
      landmark = on_inner_wall(random, walls, 0.4);
    }
  }
  return landmarks;
}

}  // namespace covey
