// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "estimator/so3.h"
#include "tests/apps/command_run.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr double kDegree = M_PI / 180;

// A lap that uses all axes, 10 Hz, `seconds` long.
StampedPoses lap(double seconds) {
  StampedPoses trajectory;
  for (int i = 0; i * 0.1 <= seconds; ++i) {
    const double t = i * 0.1;
    const Eigen::Vector3d p(3 * std::cos(t), 2 * std::sin(t), 0.5 * std::sin(2 * t));
    trajectory.push_back({nanoseconds(100 + t), {p, exp_quaternion({0.1, 0.2 * t, 0.3 * t})}});
  }
  return trajectory;
}

// `truth` as an estimator would see it whose world differs by `similarity`.
StampedPoses moved(const StampedPoses& truth, const Similarity& similarity) {
  StampedPoses estimate = truth;
  for (StampedPose& pose : estimate) pose.pose = transform(similarity, pose.pose);
  return estimate;
}

Similarity similarity(double scale, const Eigen::Vector3d& theta, const Eigen::Vector3d& t) {
  return {scale, exp_so3(theta), t};
}

TEST(Evaluation, EachAlignmentRemovesWhatItIsFor) {
  const StampedPoses truth = lap(6);
  const struct {
    Similarity difference;
    Alignment alignment;
  } cases[] = {
      {similarity(1, {0, 0, 2.5}, {1, 2, 3}), Alignment::kPosYaw},
      {similarity(1, {0.5, -1, 2.5}, {1, 2, 3}), Alignment::kSe3},
      {similarity(1.3, {0.5, -1, 2.5}, {1, 2, 3}), Alignment::kSim3},
  };
  for (const auto& [difference, alignment] : cases) {
    const auto pairs = associate(moved(truth, difference), truth, {});
    const AbsoluteError error = absolute_error(pairs, alignment);
    EXPECT_LT(error.position_m.max, 1e-9);
    EXPECT_LT(error.rotation_deg.max, 1e-6);
    EXPECT_NEAR(error.scale, 1 / difference.scale, 1e-9);
    EXPECT_GT(absolute_error(pairs, Alignment::kNone).position_m.rmse, 1);
  }
}

TEST(Evaluation, AMirroredTrajectoryIsNotMirroredBack) {
  const StampedPoses truth = lap(6);
  StampedPoses estimate = truth;
  for (StampedPose& pose : estimate) pose.pose.p_world_imu.z() *= -1;
  const auto pairs = associate(estimate, truth, {});
  EXPECT_NEAR(align(pairs, Alignment::kSe3).R_truth_estimate.determinant(), 1, 1e-9);
  EXPECT_GT(absolute_error(pairs, Alignment::kSe3).position_m.rmse, 0.1);
}

TEST(Evaluation, AKnownOffsetIsTheErrorWithoutAlignment) {
  const StampedPoses truth = lap(6);
  StampedPoses estimate = truth;
  for (StampedPose& pose : estimate) {
    pose.pose.p_world_imu += Eigen::Vector3d(0.3, 0, -0.4);
    pose.pose.q_world_imu = pose.pose.q_world_imu * exp_quaternion({0, 2 * kDegree, 0});
  }
  const AbsoluteError error = absolute_error(associate(estimate, truth, {}), Alignment::kNone);
  EXPECT_NEAR(error.position_m.rmse, 0.5, 1e-12);
  EXPECT_NEAR(error.position_m.mean, 0.5, 1e-12);
  EXPECT_NEAR(error.position_m.std, 0, 1e-7);
  EXPECT_NEAR(error.rotation_deg.rmse, 2, 1e-9);
}

TEST(Evaluation, StatisticsAreThoseOfThePopulation) {
  const ErrorStatistics result = statistics({1, 2, 3, 6});
  EXPECT_DOUBLE_EQ(result.mean, 3);
  EXPECT_DOUBLE_EQ(result.rmse, std::sqrt(12.5));
  EXPECT_DOUBLE_EQ(result.std, std::sqrt(3.5));
  EXPECT_DOUBLE_EQ(result.max, 6);
}

TEST(Evaluation, InterpolationPutsTheTruthAtTheEstimatesStamps) {
  const StampedPoses truth = {{0, {{0, 0, 0}, Eigen::Quaterniond::Identity()}},
                              {100000000, {{1, 0, 0}, exp_quaternion({0, 0, 1})}}};
  const StampedPoses estimate = {
      {-1, {}}, {0, {}}, {25000000, {}}, {100000000, {}}, {100000001, {}}};
  const auto pairs = associate(estimate, truth, {});
  ASSERT_EQ(pairs.size(), 3u);
  EXPECT_NEAR(pairs[1].truth.p_world_imu.x(), 0.25, 1e-12);
  EXPECT_NEAR(log_quaternion(pairs[1].truth.q_world_imu).z(), 0.25, 1e-12);
}

TEST(Evaluation, NobodyInterpolatesOverAHoleInTheTruth) {
  StampedPoses truth = lap(6);
  const StampedPoses estimate = truth;
  truth.erase(truth.begin() + 20, truth.begin() + 30);
  EXPECT_EQ(associate(estimate, truth, {}).size(), estimate.size() - 10);
}

TEST(Evaluation, ATruthThatIsTooSparseIsNotTakenForAnotherClock) {
  const StampedPoses estimate = lap(6);
  StampedPoses truth;
  for (std::size_t i = 5; i < estimate.size(); i += 10) {
    truth.push_back(estimate[i]);
    truth.back().stamp_ns += 1000;
  }
  const double apart_s = seconds_between(truth[0].stamp_ns, truth[1].stamp_ns);
  ASSERT_GT(apart_s, kLongestTruthGap_s);
  EXPECT_THAT([&] { (void)associate(estimate, truth, {}); },
              ThrowsMessage<std::runtime_error>(HasSubstr("more than 0.5 s apart")));
  AssociationOptions sparse;
  sparse.max_gap_s = apart_s + 0.1;
  EXPECT_GT(associate(estimate, truth, sparse).size(), 30u);
}

TEST(Evaluation, NearestStampsMatchOneToOneAndTheClosestFirst) {
  const auto at = [](double ms) { return StampedPose{nanoseconds(1 + ms * 1e-3), {}}; };
  AssociationOptions nearest;
  nearest.method = Association::kNearest;
  nearest.max_difference_s = 0.02;
  // 12 ms and 15 ms both want 14 ms: 15 ms is closer, 12 ms has to take 0 ms.
  const auto pairs = associate({at(12), at(15), at(40), at(60), at(100)},
                               {at(0), at(14), at(41), at(79), at(80), at(140)}, nearest);
  ASSERT_EQ(pairs.size(), 4u);
  EXPECT_EQ(pairs[0].stamp_ns, at(12).stamp_ns);
  EXPECT_EQ(pairs[3].stamp_ns, at(60).stamp_ns);  // 20 ms away, as 80 ms from 100 ms, is too far
}

TEST(Evaluation, ATruthThatDoesNotOverlapIsAnError) {
  const StampedPoses truth = lap(6);
  StampedPoses late = truth;
  for (StampedPose& pose : late) pose.stamp_ns += 1000000000000;
  for (const Association method : {Association::kInterpolate, Association::kNearest}) {
    AssociationOptions options;
    options.method = method;
    EXPECT_THAT([&] { (void)associate(late, truth, options); },
                ThrowsMessage<std::runtime_error>(
                    HasSubstr("from 1100.000 s to 1106.000 s, the ground truth from 100.000 s")));
    EXPECT_THROW((void)associate({}, truth, options), std::runtime_error);
    EXPECT_THROW((void)associate(truth, {}, options), std::runtime_error);
  }
}

TEST(Evaluation, RelativeErrorsDoNotCareForTheWorldFrame) {
  const StampedPoses truth = lap(6);
  const auto pairs = associate(moved(truth, similarity(1, {0.5, -1, 2}, {1, 2, 3})), truth, {});
  EXPECT_LT(relative_error_over_distance(pairs, 2)->position_m.max, 1e-9);
  EXPECT_LT(relative_error_over_time(pairs, 1)->rotation_deg.max, 1e-6);
}

TEST(Evaluation, RelativeErrorsMeasureDrift) {
  StampedPoses truth;
  StampedPoses estimate;
  for (int i = 0; i <= 100; ++i) {
    truth.push_back({nanoseconds(0.1 * i), {{0.1 * i, 0, 0}, Eigen::Quaterniond::Identity()}});
    estimate.push_back({nanoseconds(0.1 * i), {{0.102 * i, 0, 0}, Eigen::Quaterniond::Identity()}});
  }
  const auto pairs = associate(estimate, truth, {});
  const auto error = relative_error_over_distance(pairs, 5);
  ASSERT_TRUE(error.has_value());
  EXPECT_NEAR(error->position_m.rmse, 0.1, 0.003);  // 2 % of 5 m
  EXPECT_EQ(error->length, 5);
  EXPECT_NEAR(relative_error_over_time(pairs, 2)->position_m.mean, 0.04, 0.003);
  EXPECT_FALSE(relative_error_over_distance(pairs, 50).has_value());
  EXPECT_FALSE(relative_error_over_time(pairs, 50).has_value());
}

TEST(Evaluation, AnHonestCovarianceHasANeesOfThree) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto noise = [&] {
    return Eigen::Vector3d(normal(random), normal(random), normal(random));
  };
  Matrix6d L = Matrix6d::Zero();  // lower triangular root of the covariance
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col <= row; ++col) L(row, col) = row == col ? 0.05 : 0.01 * (row - 2 * col);
  }
  std::vector<PosePair> pairs;
  std::vector<StampedCovariance> covariances;
  for (TimeNs i = 0; i < 20000; ++i) {
    Eigen::Matrix<double, 6, 1> error;
    error << noise(), noise();
    error = L * error;
    PosePair pair;
    pair.stamp_ns = i * 1000000;
    pair.estimate = {noise(), exp_quaternion(noise())};
    pair.truth = {pair.estimate.p_world_imu + error.head<3>(),
                  pair.estimate.q_world_imu * exp_quaternion(error.tail<3>())};
    pairs.push_back(pair);
    covariances.push_back({pair.stamp_ns, L * L.transpose()});
  }
  const std::optional<Nees> result = nees(pairs, covariances);
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->samples, 20000);
  EXPECT_NEAR(result->position, 3, 0.06);  // 3.5 sigma of the mean
  EXPECT_NEAR(result->orientation, 3, 0.06);
}

TEST(Evaluation, NeesNeedsCovariancesThatBelongToThePoses) {
  const StampedPoses truth = lap(1);
  const auto pairs = associate(truth, truth, {});
  EXPECT_FALSE(nees(pairs, {}).has_value());
  EXPECT_FALSE(nees(pairs, {{5, Matrix6d::Identity()}}).has_value());
  EXPECT_THROW((void)nees(pairs, {{pairs[0].stamp_ns, Matrix6d::Zero()}}), std::runtime_error);
}

// Figures of rpg_trajectory_evaluation for the same files, m.
struct Reference {
  const char* name;
  double posyaw_rmse, posyaw_mean, posyaw_std, se3_rmse, sim3_rmse, sim3_scale;
};

void PrintTo(const Reference& reference, std::ostream* out) { *out << reference.name; }

class AgainstRpg : public testing::TestWithParam<Reference> {};

TEST_P(AgainstRpg, TheErrorsOfARealOdometryAgree) {
  const Reference& expected = GetParam();
  const auto folder = std::filesystem::path(COVEY_SHARED_DATA_DIR) / "evaluation" / expected.name;
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no recorded data at " << folder;
  AssociationOptions nearest;
  nearest.method = Association::kNearest;
  const auto pairs = associate(read_trajectory(folder / "estimate.txt"),
                               read_trajectory(folder / "groundtruth.txt"), nearest);
  const ErrorStatistics posyaw = absolute_error(pairs, Alignment::kPosYaw).position_m;
  const AbsoluteError sim3 = absolute_error(pairs, Alignment::kSim3);
  EXPECT_NEAR(posyaw.rmse, expected.posyaw_rmse, 1e-6);
  EXPECT_NEAR(posyaw.mean, expected.posyaw_mean, 1e-6);
  EXPECT_NEAR(posyaw.std, expected.posyaw_std, 1e-6);
  EXPECT_NEAR(absolute_error(pairs, Alignment::kSe3).position_m.rmse, expected.se3_rmse, 1e-6);
  EXPECT_NEAR(sim3.position_m.rmse, expected.sim3_rmse, 1e-6);
  EXPECT_NEAR(sim3.scale, expected.sim3_scale, 1e-5);
}

INSTANTIATE_TEST_SUITE_P(
    Euroc, AgainstRpg,
    testing::Values(Reference{"MH_01", 0.210112, 0.186808, 0.096175, 0.204094, 0.119133, 1.04003},
                    Reference{"MH_03", 0.145934, 0.135185, 0.054971, 0.144020, 0.136330, 0.98723},
                    Reference{"V2_01", 0.085253, 0.062173, 0.058332, 0.084792, 0.083680, 0.99399}),
    [](const auto& test) { return std::string(test.param.name); });

// -------------------------------------------------------------------------------- covey evaluate

class EvaluateCommand : public testing::Test {
 protected:
  std::string run(const std::string& arguments) const {
    testing::internal::CaptureStdout();
    try {
      run_command("evaluate --groundtruth " + (folder_.path() / "truth.tum").string() +
                  " --estimate " + (folder_.path() / "estimate.tum").string() + " " + arguments);
    } catch (...) {
      testing::internal::GetCapturedStdout();
      throw;
    }
    return testing::internal::GetCapturedStdout();
  }

  TemporaryFolder folder_;
};

TEST_F(EvaluateCommand, PrintsATableOrJson) {
  write_tum(folder_.path() / "truth.tum", lap(6));
  write_tum(folder_.path() / "estimate.tum",
            moved(lap(6), similarity(1, Eigen::Vector3d::Zero(), {0.3, 0, -0.4})));
  EXPECT_THAT(run("--align none"), HasSubstr("none           0.500000"));
  EXPECT_THAT(run("--json --align none"), HasSubstr("\"matched\": 61"));
  EXPECT_THAT(run("--json"), HasSubstr("\"nees\": null"));
}

TEST_F(EvaluateCommand, NamesBothFilesWhenTheyDoNotOverlap) {
  StampedPoses late = lap(6);
  for (StampedPose& pose : late) pose.stamp_ns += 1000000000000;
  write_tum(folder_.path() / "truth.tum", lap(6));
  write_tum(folder_.path() / "estimate.tum", late);
  EXPECT_THAT([this] { (void)run(""); },
              ThrowsMessage<std::runtime_error>(
                  testing::AllOf(HasSubstr("estimate.tum against"), HasSubstr("truth.tum: "))));
}

TEST_F(EvaluateCommand, RefusesCovariancesThatBelongToNoPose) {
  write_tum(folder_.path() / "truth.tum", lap(6));
  write_tum(folder_.path() / "estimate.tum", lap(6));
  std::string sample = "7000000000000000000";
  for (int i = 0; i < 21; ++i) sample += ",1";
  for (const std::string& content : {std::string(), sample + "\n"}) {
    const std::string file = folder_.write("covariance.csv", content).string();
    EXPECT_THAT(
        [&] { (void)run("--covariance " + file); },
        ThrowsMessage<std::runtime_error>(file + ": no covariance at the estimate's stamps"));
  }
}

TEST_F(EvaluateCommand, RefusesUnknownWords) {
  EXPECT_THAT([this] { (void)run("--align yaw"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("--align")));
  EXPECT_THAT([this] { (void)run("--association best"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("--association")));
  EXPECT_THAT([this] { (void)run("--max-difference -1"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("--max-difference")));
}

}  // namespace
}  // namespace covey
