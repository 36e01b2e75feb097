// SPDX-License-Identifier: Apache-2.0
//
// Two drones that know nothing of each other's start: at the castle, and where places look alike
// (perceptual aliasing), along a row of houses that are all the same, on a lawn that is not.
// Rendered images, whole pipelines; minutes without optimisation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/pipeline.h"
#include "apps/team.h"
#include "sim/simulation.h"

namespace covey {
namespace {

constexpr float kPitch = 5;  // m, from house to house
constexpr double kDegrees = 180 / M_PI;

// Where the castle stands otherwise.
Scene row_of_houses(const Scene& castle) {
  constexpr float kOfTheCastle = 18.5F;  // m, from the middle
  constexpr int kFirst = -8, kLast = 14;
  enum Surface { kMasonry, kPlaster };
  Scene scene = castle;
  scene.primitives.clear();
  for (const Primitive& thing : castle.primitives) {
    const bool everywhere = thing.shape == Shape::kGround || thing.shape == Shape::kSkyline;
    if (everywhere || thing.center.head<2>().norm() > kOfTheCastle) {
      scene.primitives.push_back(thing);
    }
  }
  for (int i = kFirst; i <= kLast; ++i) {
    const float x = kPitch * static_cast<float>(i);
    scene.primitives.push_back({Shape::kBox, {x, -14, 3}, {2, 1.5F, 3}, 0, kMasonry, {3, 7}});
    scene.primitives.push_back(
        {Shape::kBox, {x + 0.7F, -15.9F, 1}, {0.6F, 0.4F, 1}, 0, kPlaster, {13, 27}});
  }
  return scene;
}

Scene moved(Scene scene, float x) {
  for (Primitive& thing : scene.primitives) thing.center.x() += x;
  return scene;
}

// A drone that flies in this process, in a world of its own.
class Flyer {
 public:
  explicit Flyer(DroneSimulation simulation)
      : simulation_(std::move(simulation)),
        pipeline_(config(), sensors(), GroundTruth{simulation_.true_states()}) {}

  [[nodiscard]] std::size_t images() const { return simulation_.image_stamps().size(); }

  std::optional<PlaceAdvert> fly_on() {
    const TimeNs stamp_ns = simulation_.image_stamps()[next_image_++];
    add_imu_for(stamp_ns, simulation_.plan().imu.samples, next_imu_, pipeline_);
    return pipeline_.add_image(stamp_ns, simulation_.next_image().grey).advert;
  }

  [[nodiscard]] const std::string& name() const { return simulation_.name(); }
  [[nodiscard]] Pipeline& pipeline() { return pipeline_; }

 private:
  [[nodiscard]] AgentConfig config() const {
    TeamOptions options;
    options.out = "no run is written";
    options.unknown_start = true;
    return agent_config(options, {simulation_.name(), "no dataset is read"}, 0);
  }
  [[nodiscard]] SensorSetup sensors() const {
    return {simulation_.camera().intrinsics, simulation_.plan().flight.extrinsics,
            simulation_.plan().imu_noise, false};
  }

  DroneSimulation simulation_;
  Pipeline pipeline_;
  std::size_t next_image_ = 0, next_imu_ = 0;
};

struct WorldError {
  double position_m = 0, angle_deg = 0;
};

// By how much the one is wrong about where the other's world lies, and how it is turned, where the
// other is; nothing while it is unknown.
std::optional<WorldError> error_of(Flyer& own, Flyer& peer, float peer_ahead_m) {
  const auto found = own.pipeline().team_knowledge()->alignment(peer.name());
  if (!found) return std::nullopt;
  Eigen::Isometry3d T_own_peer_scene = Eigen::Isometry3d::Identity();
  T_own_peer_scene.translation().x() = static_cast<double>(peer_ahead_m);
  const Eigen::Isometry3d truth =
      own.pipeline().own_world().inverse() * T_own_peer_scene * peer.pipeline().own_world();
  const Eigen::AngleAxisd turned(found->T_own_peer.linear().transpose() * truth.linear());
  return WorldError{(found->T_own_peer * found->p_peer - truth * found->p_peer).norm(),
                    turned.angle() * kDegrees};
}

struct Outcome {
  int found = 0;               // of the two worlds, in the end
  WorldError largest, at_end;  // at any time; in the end, the larger of the two
};

void keep_larger(WorldError& largest, const WorldError& error) {
  largest.position_m = std::max(largest.position_m, error.position_m);
  largest.angle_deg = std::max(largest.angle_deg, error.angle_deg);
}

// They ask each other after each image.
Outcome fly_together(Flyer uav0, Flyer uav1, float ahead_m) {
  Outcome outcome;
  for (std::size_t i = 0; i < std::min(uav0.images(), uav1.images()); ++i) {
    const auto ask0 = uav0.fly_on(), ask1 = uav1.fly_on();
    const auto told1 = ask1 ? uav0.pipeline().answer(*ask1) : std::nullopt;
    const auto told0 = ask0 ? uav1.pipeline().answer(*ask0) : std::nullopt;
    if (told0) (void)uav0.pipeline().fuse(*told0);
    if (told1) (void)uav1.pipeline().fuse(*told1);
    outcome.found = 0;
    outcome.at_end = {};
    for (const std::optional<WorldError>& error :
         {error_of(uav0, uav1, ahead_m), error_of(uav1, uav0, -ahead_m)}) {
      if (!error) continue;
      ++outcome.found;
      keep_larger(outcome.largest, *error);
      keep_larger(outcome.at_end, *error);
    }
  }
  return outcome;
}

std::vector<DroneSimulation> two_at_the_castle(std::uint64_t seed) {
  SimulationRequest request;
  request.scenario = Scenario::kCastleParallel;
  request.seed = seed;
  request.agents = 2;
  request.camera_rate_hz = 15;
  request.duration_s = 13;
  return make_simulation(request);
}

// uav1 starts so many houses ahead of uav0 and flies as fast.
Outcome fly_along_the_row(std::uint64_t seed, int houses_ahead) {
  const std::vector<DroneSimulation> at_the_castle = two_at_the_castle(seed);
  const Scene row = row_of_houses(at_the_castle[0].scene());
  const auto renderer = std::make_shared<const Renderer>(visual_intrinsics());
  const float ahead_m = kPitch * static_cast<float>(houses_ahead);
  const auto flyer = [&](std::size_t drone, float x) {
    return Flyer(DroneSimulation(at_the_castle[drone].plan(),
                                 std::make_shared<const Scene>(moved(row, x)), renderer));
  };
  return fly_together(flyer(0, 0), flyer(1, -ahead_m), ahead_m);
}

TEST(PerceptualAliasing, AHouseIsNotTakenForTheNext) {
  const Outcome outcome = fly_along_the_row(2, 3);
  EXPECT_LT(outcome.largest.position_m, 0.3);
  EXPECT_LT(outcome.largest.angle_deg, 0.5);
  EXPECT_GE(outcome.found, 1) << "where the first one started the other comes by later";
}

TEST(PerceptualAliasing, WorldsAreFoundBetweenHousesThatAreAllTheSame) {
  const Outcome outcome = fly_along_the_row(2, 0);
  EXPECT_LT(outcome.largest.position_m, 0.3);
  EXPECT_LT(outcome.largest.angle_deg, 0.5);
  EXPECT_EQ(outcome.found, 2);
}

TEST(UnknownStart, AtTheCastleWorldsAreFoundToTenCentimetresAndHalfADegree) {
  std::vector<DroneSimulation> drones = two_at_the_castle(4);
  const Outcome outcome = fly_together(Flyer(std::move(drones[0])), Flyer(std::move(drones[1])), 0);
  EXPECT_EQ(outcome.found, 2);
  EXPECT_LT(outcome.at_end.position_m, 0.1);
  EXPECT_LT(outcome.at_end.angle_deg, 0.5);
  EXPECT_LT(outcome.largest.position_m, 0.3) << "none was false";
}

}  // namespace
}  // namespace covey
