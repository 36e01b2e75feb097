// SPDX-License-Identifier: Apache-2.0
#include "sim/scenario_motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace covey {
namespace {

constexpr double kDegree = M_PI / 180;

std::vector<DronePlan> planned(Scenario scenario, std::uint64_t seed, int agents = 0) {
  FlightRequest request;
  request.scenario = scenario;
  request.seed = seed;
  request.agents = agents;
  return plan_flights(request);
}

struct Extremes {
  double speed = 0, tilt = 0, omega = 0, lowest = 1e9, highest = -1e9;
  Eigen::Vector3d omega_rms = Eigen::Vector3d::Zero(), accel_rms = Eigen::Vector3d::Zero();
};

Extremes extremes(const Trajectory& trajectory) {
  Extremes e;
  int count = 0;
  for (double t = 0; t < trajectory.duration_s(); t += 0.02, ++count) {
    const KinematicState state = trajectory.at(t);
    const double up = (state.pose.q_world_imu * Eigen::Vector3d::UnitZ()).z();
    e.speed = std::max(e.speed, state.v_world_imu.norm());
    e.tilt = std::max(e.tilt, std::acos(std::min(1.0, up)));
    e.omega = std::max(e.omega, state.omega_imu.norm());
    e.lowest = std::min(e.lowest, state.pose.p_world_imu.z());
    e.highest = std::max(e.highest, state.pose.p_world_imu.z());
    e.omega_rms += state.omega_imu.cwiseAbs2();
    e.accel_rms += state.a_world_imu.cwiseAbs2();
  }
  e.omega_rms = (e.omega_rms / count).cwiseSqrt();
  e.accel_rms = (e.accel_rms / count).cwiseSqrt();
  return e;
}

Eigen::Vector3d view_direction(const DronePlan& plan, double time_s) {
  return plan.trajectory.pose_at(time_s).q_world_imu *
         (plan.extrinsics.q_imu_cam * Eigen::Vector3d::UnitZ());
}

TEST(ScenarioMotion, CastleAroundFliesLapsOf220MetresThatSeeTheCastle) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto plans = planned(Scenario::kCastleAround, seed);
    ASSERT_EQ(plans.size(), 4u);
    for (const DronePlan& plan : plans) {
      EXPECT_NEAR(plan.trajectory.duration_s(), 30, 1e-9);
      EXPECT_NEAR(plan.trajectory.length_m(0, 30), 220, 4);
      const Extremes e = extremes(plan.trajectory);
      EXPECT_LT(e.speed, 10);
      EXPECT_LT(e.tilt, 40 * kDegree);
      EXPECT_GT(e.lowest, 3);
      EXPECT_LT(e.highest, 15);
      for (double t = 0; t < 30; t += 0.5) {
        const Eigen::Vector3d p = plan.trajectory.pose_at(t).p_world_imu;
        EXPECT_GT(p.head<2>().cwiseAbs().maxCoeff(), 20) << "m from the centre of the castle";
        const Eigen::Vector2d view = view_direction(plan, t).head<2>().normalized();
        EXPECT_GT(view.dot(-p.head<2>().normalized()), std::cos(35 * kDegree));
      }
    }
  }
}

TEST(ScenarioMotion, CastleParallelFlies30MetresAlongTheFacadeAtOneHeight) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto plans = planned(Scenario::kCastleParallel, seed);
    ASSERT_EQ(plans.size(), 3u);
    const double height = plans[0].trajectory.pose_at(0).p_world_imu.z();
    for (const DronePlan& plan : plans) {
      EXPECT_NEAR(plan.trajectory.duration_s(), 9, 1e-9);
      EXPECT_NEAR(plan.trajectory.length_m(0, 9), 30, 1);
      const Extremes e = extremes(plan.trajectory);
      EXPECT_NEAR(e.lowest, height, 0.5);
      EXPECT_NEAR(e.highest, height, 0.5);
      EXPECT_LT(e.tilt, 40 * kDegree);
      for (double t = 0; t < 9; t += 0.5) {
        EXPECT_LT(plan.trajectory.pose_at(t).p_world_imu.y(), -20);
        EXPECT_GT(view_direction(plan, t).y(), 0.7);
      }
    }
  }
}

TEST(ScenarioMotion, MarsYardFliesTwoLapsLookingDown) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const auto plans = planned(Scenario::kMarsYard, seed);
    ASSERT_EQ(plans.size(), 2u);
    EXPECT_NEAR(plans[0].trajectory.length_m(0, 20), 11, 0.7);
    EXPECT_NEAR(plans[1].trajectory.length_m(0, 20), 18, 0.7);
    for (const DronePlan& plan : plans) {
      const Extremes e = extremes(plan.trajectory);
      EXPECT_GT(e.lowest, 1.5);
      EXPECT_LT(e.highest, 5);
      for (double t = 0; t < 20; t += 0.5) EXPECT_LT(view_direction(plan, t).z(), -0.8);
    }
  }
}

TEST(ScenarioMotion, OwnRoomFlightsStayInsideTheRoom) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    for (const DronePlan& plan : planned(Scenario::kRoom, seed)) {
      for (double t = 0; t < 30; t += 0.05) {
        const Eigen::Vector3d p = plan.trajectory.pose_at(t).p_world_imu;
        ASSERT_LT(std::abs(p.x()), 2.6);
        ASSERT_LT(std::abs(p.y()), 2.1);
        ASSERT_GT(p.z(), 0.7);
        ASSERT_LT(p.z(), 2.3);
      }
    }
  }
}

TEST(ScenarioMotion, EveryFlightHoversFirstAndThenExcitesAllAxes) {
  for (const Scenario scenario :
       {Scenario::kCastleAround, Scenario::kCastleParallel, Scenario::kMarsYard, Scenario::kRoom}) {
    for (const DronePlan& plan : planned(scenario, 3, 6)) {
      SCOPED_TRACE(std::string(scenario_name(scenario)) + " " + plan.name);
      EXPECT_LT(plan.trajectory.length_m(0, 0.8), 0.05);
      const Extremes e = extremes(plan.trajectory);
      EXPECT_GT(e.omega_rms.minCoeff(), 0.04) << "rad/s";
      EXPECT_GT(e.accel_rms.minCoeff(), 0.1) << "m/s2";
      EXPECT_LT(e.omega, 3) << "rad/s";
    }
  }
}

TEST(ScenarioMotion, IsTheSameForOneSeedAndDiffersForAnother) {
  const auto a = planned(Scenario::kCastleAround, 4), b = planned(Scenario::kCastleAround, 4);
  const auto c = planned(Scenario::kCastleAround, 5);
  for (std::size_t k = 0; k < a.size(); ++k) {
    const Pose pose = a[k].trajectory.pose_at(12.3), same = b[k].trajectory.pose_at(12.3);
    EXPECT_EQ(pose.p_world_imu, same.p_world_imu);
    EXPECT_EQ(pose.q_world_imu.coeffs(), same.q_world_imu.coeffs());
    EXPECT_NE(pose.p_world_imu, c[k].trajectory.pose_at(12.3).p_world_imu);
  }
}

TEST(ScenarioMotion, MoreAgentsFlyApartFromEachOther) {
  for (const Scenario scenario : {Scenario::kCastleAround, Scenario::kCastleParallel}) {
    const auto plans = planned(scenario, 2, 8);
    ASSERT_EQ(plans.size(), 8u);
    for (std::size_t i = 0; i < plans.size(); ++i) {
      EXPECT_EQ(plans[i].name, "uav" + std::to_string(i));
      for (std::size_t k = 0; k < i; ++k) {
        const Eigen::Vector3d apart =
            plans[i].trajectory.pose_at(5).p_world_imu - plans[k].trajectory.pose_at(5).p_world_imu;
        EXPECT_GT(apart.norm(), 1.0) << plans[i].name << " and " << plans[k].name;
      }
    }
  }
}

TEST(ScenarioMotion, RecordedTrajectoriesAreFlownOneByEachDrone) {
  FlightRequest request;
  request.scenario = Scenario::kRoom;
  for (const DronePlan& plan : planned(Scenario::kRoom, 9)) {
    request.recorded.push_back(plan.trajectory);
  }
  request.duration_s = 12;
  const auto plans = plan_flights(request);
  ASSERT_EQ(plans.size(), 2u);
  EXPECT_EQ(plans[1].trajectory.duration_s(), 12);
  EXPECT_EQ(plans[1].trajectory.pose_at(7).p_world_imu, request.recorded[1].pose_at(7).p_world_imu);
  request.agents = 3;
  EXPECT_THROW(static_cast<void>(plan_flights(request)), std::runtime_error);
}

TEST(ScenarioMotion, LegsLeadThereAndBackThroughTheSamePosesAndRestAtTheTurns) {
  FlightRequest request;
  request.scenario = Scenario::kCastleAround;
  request.seed = 6;
  request.legs = 4;
  constexpr double kLeg_s = 30;
  for (const DronePlan& plan : plan_flights(request)) {
    EXPECT_NEAR(plan.trajectory.duration_s(), 4 * kLeg_s, 1e-9);
    EXPECT_GT(plan.trajectory.length_m(0, kLeg_s), 180);
    EXPECT_LT(extremes(plan.trajectory).tilt, 40 * kDegree);
    for (const double turn_s : {kLeg_s, 2 * kLeg_s, 3 * kLeg_s}) {
      EXPECT_LT(plan.trajectory.at(turn_s).v_world_imu.norm(), 1e-6);
      EXPECT_LT(plan.trajectory.at(turn_s).omega_imu.norm(), 1e-5);
      for (double t = 0.05; t < kLeg_s; t += 0.7) {
        const Pose before = plan.trajectory.pose_at(turn_s - t);
        const Pose after = plan.trajectory.pose_at(turn_s + t);
        ASSERT_LT((before.p_world_imu - after.p_world_imu).norm(), 1e-6) << turn_s << " +- " << t;
        ASSERT_LT(before.q_world_imu.angularDistance(after.q_world_imu), 1e-5);
      }
    }
  }
}

TEST(ScenarioMotion, ImpossibleRequestsAreRefused) {
  FlightRequest request;
  request.agents = -1;
  EXPECT_THROW(static_cast<void>(plan_flights(request)), std::runtime_error);
  request.agents = 0;
  request.duration_s = -3;
  EXPECT_THROW(static_cast<void>(plan_flights(request)), std::runtime_error);
  request.duration_s = 0;
  request.legs = 0;
  EXPECT_THROW(static_cast<void>(plan_flights(request)), std::runtime_error);
}

TEST(ScenarioMotion, NamesAreReadAndWritten) {
  for (const char* name : {"castle_around", "castle_parallel", "mars_yard", "room"}) {
    const auto scenario = scenario_from_name(name);
    ASSERT_TRUE(scenario.has_value());
    EXPECT_EQ(scenario_name(*scenario), name);
  }
  EXPECT_FALSE(scenario_from_name("moon").has_value());
}

}  // namespace
}  // namespace covey
