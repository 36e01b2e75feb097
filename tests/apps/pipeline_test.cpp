// SPDX-License-Identifier: Apache-2.0
#include "apps/pipeline.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <opencv2/core.hpp>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/dataset.h"
#include "apps/grey_image.h"
#include "apps/initialisation.h"
#include "comms/checks.h"
#include "estimator/so3.h"

namespace covey {
namespace {

Dataset test_flight(const std::string& drone = "uav0") {
  return read_dataset(std::filesystem::path(COVEY_TEST_FLIGHT) / drone / "mav0");
}

std::vector<ImuSample> turning(double rate, double seconds) {
  std::vector<ImuSample> imu;
  for (int i = 0; i <= static_cast<int>(seconds * 200); ++i) {
    imu.push_back({nanoseconds(i * 0.005), Eigen::Vector3d(0, 0, rate), {0, 0, 9.81}});
  }
  return imu;
}

TEST(IntegrateGyro, TurnsByRateTimesTimeBetweenTheStamps) {
  const auto q =
      integrate_gyro(turning(0.5, 1), nanoseconds(0.1033), nanoseconds(0.7071), {0, 0, 0});
  EXPECT_NEAR(log_quaternion(q).z(), 0.5 * (0.7071 - 0.1033), 1e-9);
}

TEST(IntegrateGyro, TakesTheBiasAway) {
  const auto q = integrate_gyro(turning(0.5, 1), 0, nanoseconds(1), {0, 0, 0.5});
  EXPECT_NEAR(log_quaternion(q).norm(), 0, 1e-12);
}

TEST(IntegrateGyro, TurnsOfTwoPartsMakeTheWholeTurn) {
  std::vector<ImuSample> imu = turning(0.5, 1);
  for (std::size_t i = 0; i < imu.size(); ++i)
    imu[i].gyro_imu.x() = std::sin(0.1 * static_cast<double>(i));
  const TimeNs begin_ns = nanoseconds(0.1033), end_ns = nanoseconds(0.7071);
  const TimeNs between_ns = nanoseconds(0.4012);
  const auto whole = integrate_gyro(imu, begin_ns, end_ns, {0, 0, 0});
  const auto first = integrate_gyro(imu, begin_ns, between_ns, {0, 0, 0});
  const auto rest = integrate_gyro(imu, between_ns, end_ns, {0, 0, 0});
  EXPECT_LT(whole.angularDistance(first * rest), 1e-9);
}

TEST(IntegrateGyro, WithoutSamplesThereIsNoTurn) {
  EXPECT_EQ(integrate_gyro({}, 0, 100, {0, 0, 0}).w(), 1);
}

TEST(TurnAt, IsALineThroughTheNewestSamples) {
  std::vector<ImuSample> imu;
  const Eigen::Vector3d rate(0.3, -0.2, 0.1), acceleration(5, 2, -7), bias(0.01, 0.02, 0.03);
  for (int i = -20; i <= 1; ++i) {
    const double t = 0.005 * i;
    ImuSample sample;
    sample.stamp_ns = nanoseconds(2 + t);
    // What is older is another motion.
    sample.gyro_imu = t < -0.022 ? Eigen::Vector3d(9, 9, 9) : rate + t * acceleration + bias;
    imu.push_back(sample);
  }
  const Turn turn = turn_at(imu, nanoseconds(2.0), bias);
  EXPECT_TRUE(turn.rate.isApprox(rate, 1e-9));
  EXPECT_TRUE(turn.acceleration.isApprox(acceleration, 1e-9));
}

TEST(TurnAt, OfTooFewSamplesIsTheirMean) {
  std::vector<ImuSample> imu(2);
  imu[0].stamp_ns = nanoseconds(1.98);
  imu[1].stamp_ns = nanoseconds(2.0);
  imu[0].gyro_imu = {1, 0, 0};
  imu[1].gyro_imu = {2, 0, 0};
  const Turn turn = turn_at(imu, nanoseconds(2.0), {0.5, 0, 0});
  EXPECT_EQ(turn.rate, Eigen::Vector3d(1, 0, 0));
  EXPECT_TRUE(turn.acceleration.isZero());
  EXPECT_TRUE(turn_at({}, nanoseconds(2.0), {0.5, 0, 0}).rate.isZero());
}

TEST(GreyImage, SixteenBitsAreStretchedToWhatTheyHold) {
  cv::Mat raw(100, 100, CV_16UC1);
  for (int y = 0; y < raw.rows; ++y) raw.row(y).setTo(20000 + 10 * y);
  raw.at<std::uint16_t>(0, 0) = 0;  // a dead pixel
  const cv::Mat grey = to_grey8(raw);
  EXPECT_EQ(grey.type(), CV_8UC1);
  EXPECT_LT(grey.at<std::uint8_t>(1, 50), 10);
  EXPECT_GT(grey.at<std::uint8_t>(98, 50), 245);
}

TEST(GreyImage, EightBitsAndUniformImagesStayAsTheyAre) {
  const cv::Mat image(10, 10, CV_8UC1, cv::Scalar(77));
  EXPECT_EQ(to_grey8(image).data, image.data);
  EXPECT_EQ(to_grey8(cv::Mat(10, 10, CV_16UC1, cv::Scalar(300))).type(), CV_8UC1);
}

GroundTruth straight_flight() {
  GroundTruth truth;
  for (int i = 0; i <= 10; ++i) {
    TrueState state;
    state.stamp_ns = nanoseconds(1 + 0.1 * i);
    state.pose.p_world_imu.x() = 0.2 * i;
    state.pose.q_world_imu = exp_quaternion({0, 0, 0.3});
    state.v_world_imu.x() = 2;
    state.gyro_bias.x() = 0.01;
    truth.states.push_back(state);
  }
  return truth;
}

TEST(Initialisation, FromGroundTruthWaitsUntilItIsThere) {
  const Initialisation start({}, 9.81, straight_flight());
  EXPECT_TRUE(std::holds_alternative<NotStill>(start.start_at(nanoseconds(0.9), {})));
  const auto state = std::get<InitialState>(start.start_at(nanoseconds(1.25), {}));
  EXPECT_NEAR(state.pose.p_world_imu.x(), 0.5, 1e-9);
  EXPECT_NEAR(state.v_world_imu.x(), 2, 1e-9);
  EXPECT_EQ(state.gyro_bias.norm(), 0) << "the truth tells pose and velocity, nothing else";
}

TEST(Initialisation, FromGroundTruthThatIsMissingIsAnError) {
  EXPECT_THAT([] { Initialisation({}, 9.81, std::nullopt); },
              ::testing::ThrowsMessage<std::runtime_error>(
                  ::testing::HasSubstr("set initialisation.method to static")));
}

TEST(Initialisation, StandingStillTakesPlaceAndYawFromTheTruthAndTheRestFromTheImu) {
  InitialisationConfig config;
  config.method = InitMethod::kStatic;
  std::vector<ImuSample> imu = turning(0.02, 1);
  const Initialisation start(config, 9.81, straight_flight());
  const auto state = std::get<InitialState>(start.start_at(imu.back().stamp_ns, imu));
  EXPECT_NEAR(log_quaternion(state.pose.q_world_imu).z(), 0.3, 1e-9);
  EXPECT_NEAR(state.gyro_bias.z(), 0.02, 1e-9);
  EXPECT_EQ(state.v_world_imu.norm(), 0);
}

// EuRoC's IMU has its x axis up: a yaw of Euler's angles would be any.
TEST(Initialisation, StandingStillTakesTheYawFromTheTruthHoweverTheImuIsMounted) {
  Eigen::Matrix3d R_world_imu;
  R_world_imu << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  GroundTruth truth = straight_flight();
  for (TrueState& state : truth.states) state.pose.q_world_imu = Eigen::Quaterniond(R_world_imu);
  std::vector<ImuSample> imu = turning(0, 1);
  for (ImuSample& sample : imu) sample.accel_imu = {9.81, 0.1, -0.1};
  InitialisationConfig config;
  config.method = InitMethod::kStatic;
  const Initialisation start(config, 9.81, truth);
  const auto state = std::get<InitialState>(start.start_at(imu.back().stamp_ns, imu));
  EXPECT_LT(state.pose.q_world_imu.angularDistance(Eigen::Quaterniond(R_world_imu)), 0.015);
}

TEST(Initialisation, StandingStillWithoutTruthStartsWhereTheConfigurationSays) {
  InitialisationConfig config;
  config.method = InitMethod::kStatic;
  config.p_world_imu = {1, 2, 3};
  config.yaw = -0.7;
  const std::vector<ImuSample> imu = turning(0, 1);
  const Initialisation start(config, 9.81, std::nullopt);
  const auto state = std::get<InitialState>(start.start_at(imu.back().stamp_ns, imu));
  EXPECT_EQ(state.pose.p_world_imu, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(log_quaternion(state.pose.q_world_imu).z(), -0.7, 1e-9);
}

TEST(Initialisation, ADroneThatMovesDoesNotStandStill) {
  InitialisationConfig config;
  config.method = InitMethod::kStatic;
  const std::vector<ImuSample> imu = turning(0.8, 1);
  const Initialisation start(config, 9.81, std::nullopt);
  EXPECT_TRUE(std::holds_alternative<NotStill>(start.start_at(imu.back().stamp_ns, imu)));
}

// One drone of the small simulated flight, fed by hand.
class Drone {
 public:
  Drone(const std::string& name, FlightMode mode, ExchangeMode exchange = ExchangeMode::kCompact,
        const KeyframeRule& question = {}, ThermalMode thermal = ThermalMode::kAuto)
      : dataset_(test_flight(name)),
        pipeline_(config(name, mode, exchange, question, thermal),
                  {dataset_.camera, dataset_.extrinsics, dataset_.imu_noise},
                  dataset_.ground_truth) {}

  [[nodiscard]] std::size_t images() const { return dataset_.images.size(); }
  [[nodiscard]] Pipeline& pipeline() { return pipeline_; }

  ImageResult fly(std::size_t index) {
    const ImageEntry& image = dataset_.images.at(index);
    return fly(index, read_image(image, dataset_.camera.width, dataset_.camera.height));
  }
  ImageResult fly_without_imu(std::size_t index) {
    const ImageEntry& image = dataset_.images.at(index);
    return pipeline_.add_image(image.stamp_ns,
                               read_image(image, dataset_.camera.width, dataset_.camera.height));
  }
  void lose_imu_before(std::size_t index) {
    while (dataset_.imu[next_imu_ + 1].stamp_ns <= dataset_.images.at(index).stamp_ns) ++next_imu_;
  }
  // As if the camera saw a wall.
  ImageResult fly_blind(std::size_t index) {
    return fly(index, cv::Mat(dataset_.camera.height, dataset_.camera.width, CV_8UC1, 100.0));
  }

 private:
  ImageResult fly(std::size_t index, const cv::Mat& pixels) {
    const ImageEntry& image = dataset_.images.at(index);
    while (next_imu_ < dataset_.imu.size()) {
      const ImuSample& sample = dataset_.imu[next_imu_++];
      pipeline_.add_imu(sample);
      if (sample.stamp_ns > image.stamp_ns) break;
    }
    return pipeline_.add_image(image.stamp_ns, pixels);
  }
  static AgentConfig config(const std::string& name, FlightMode mode, ExchangeMode exchange,
                            const KeyframeRule& question, ThermalMode thermal) {
    AgentConfig config;
    config.thermal.mode = thermal;
    config.agent.name = name;
    config.agent.mode = mode;
    config.collaboration.exchange = exchange;
    config.collaboration.question = question;
    // A few images from a start at rest: the paper's descriptor says little of them.
    if (exchange != ExchangeMode::kCompact) config.collaboration.place_threshold = 0.2;
    return config;
  }

  Dataset dataset_;
  Pipeline pipeline_;
  std::size_t next_imu_ = 0;
};

// Of a drone that stands still for so long: when it asks, s, and whether with corners.
std::vector<std::pair<double, bool>> questions_at_rest(double seconds) {
  const Dataset dataset = test_flight();
  const cv::Mat seen =
      read_image(dataset.images.front(), dataset.camera.width, dataset.camera.height);
  AgentConfig config;
  config.initialisation.method = InitMethod::kStatic;
  Pipeline pipeline(config, sensors_of(dataset), {});
  ImuSample at_rest;
  at_rest.accel_imu = dataset.ground_truth->states.front().pose.q_world_imu.conjugate() *
                      Eigen::Vector3d(0, 0, 9.81);
  std::vector<std::pair<double, bool>> questions;
  constexpr double kImages_s = 0.1, kSamples_s = 0.005;
  for (int image = 0; image * kImages_s < seconds; ++image) {
    for (; at_rest.stamp_ns <= nanoseconds(image * kImages_s);
         at_rest.stamp_ns += nanoseconds(kSamples_s)) {
      pipeline.add_imu(at_rest);
    }
    const ImageResult result = pipeline.add_image(nanoseconds(image * kImages_s), seen);
    if (result.advert)
      questions.emplace_back(image * kImages_s, !result.advert->descriptor.empty());
  }
  return questions;
}

TEST(Pipeline, ADroneThatStandsAsksAgainEverMoreRarelyAsLongAsNobodyAnswers) {
  const auto questions = questions_at_rest(12);
  ASSERT_EQ(questions.size(), 3u);
  const auto& [first_s, first_with_corners] = questions[0];
  EXPECT_LT(first_s, 1.5) << "it has started";
  EXPECT_NEAR(questions[1].first - first_s, 3, 0.11);
  EXPECT_NEAR(questions[2].first - questions[1].first, 6, 0.11);
  for (const auto& [when_s, with_corners] : questions) EXPECT_TRUE(with_corners) << when_s;
}

TEST(Pipeline, SameInputGivesBitEqualOdometry) {
  Drone one("uav0", FlightMode::kSolo), other("uav0", FlightMode::kSolo);
  for (std::size_t i = 0; i < 10; ++i) {
    const ImageResult a = one.fly(i), b = other.fly(i);
    ASSERT_EQ(a.odometry.has_value(), b.odometry.has_value());
    if (!a.odometry) continue;
    EXPECT_EQ(a.odometry->pose.p_world_imu, b.odometry->pose.p_world_imu);
    EXPECT_EQ(a.odometry->pose.q_world_imu.coeffs(), b.odometry->pose.q_world_imu.coeffs());
    EXPECT_EQ(a.odometry->pose_covariance, b.odometry->pose_covariance);
  }
  EXPECT_TRUE(one.pipeline().started());
}

// Of its motion, when the camera stamps its images that much too late.
std::vector<Odometry> told_of_first_images(Pipeline& pipeline, const Dataset& dataset,
                                           TimeNs late_ns = 0) {
  std::vector<Odometry> told;
  std::size_t next_imu = 0;
  for (std::size_t i = 0; i < 12; ++i) {
    const ImageEntry& image = dataset.images.at(i);
    const TimeNs stamp_ns = image.stamp_ns + late_ns;
    add_imu_for(stamp_ns, dataset.imu, next_imu, pipeline);
    const ImageResult result = pipeline.add_image(
        stamp_ns, read_image(image, dataset.camera.width, dataset.camera.height));
    if (result.odometry) told.push_back(*result.odometry);
  }
  return told;
}

// Odometry of a flight over visual images, whose camera is named thermal or not.
std::vector<Odometry> flown_as(ThermalMode mode, bool named) {
  const Dataset dataset = test_flight();
  AgentConfig config;
  config.agent.mode = FlightMode::kSolo;
  config.thermal.mode = mode;
  SensorSetup sensors = sensors_of(dataset);
  sensors.thermal = named;
  Pipeline pipeline(config, sensors, dataset.ground_truth);
  return told_of_first_images(pipeline, dataset);
}

bool bit_equal(const std::vector<Odometry>& some, const std::vector<Odometry>& others) {
  return std::equal(some.begin(), some.end(), others.begin(), others.end(),
                    [](const Odometry& a, const Odometry& b) {
                      return a.pose.p_world_imu == b.pose.p_world_imu &&
                             a.pose_covariance == b.pose_covariance;
                    });
}

TEST(Pipeline, ACameraToBeCalibratedIsFlownAsOneThatIsNamedThermal) {
  const auto calibrated = flown_as(ThermalMode::kCalibrated, false);
  ASSERT_GT(calibrated.size(), 5u);
  EXPECT_TRUE(bit_equal(calibrated, flown_as(ThermalMode::kAuto, true)));
  EXPECT_FALSE(bit_equal(flown_as(ThermalMode::kRaw, false), flown_as(ThermalMode::kRaw, true)))
      << "noise is that of thermal cameras, on raw images as well";
}

TEST(Pipeline, ABlindCameraLeavesNoMoreSamplesThanOneThatSees) {
  Drone drone("uav0", FlightMode::kSolo, ExchangeMode::kCompact, {}, ThermalMode::kCalibrated);
  for (std::size_t i = 0; i < 10; ++i) (void)drone.fly(i);
  ASSERT_TRUE(drone.pipeline().started());
  const std::size_t kept = drone.pipeline().imu_samples_kept();
  for (std::size_t i = 10; i < drone.images(); ++i) {
    ASSERT_EQ(drone.fly_blind(i).content, ImageContent::kUniform);
    EXPECT_LE(drone.pipeline().imu_samples_kept(), kept + 1);
  }
}

// Of a drone whose settings say so.
std::vector<Odometry> flown_with_late_stamps(TimeNs late_ns) {
  const Dataset dataset = test_flight();
  AgentConfig config;
  config.agent.mode = FlightMode::kSolo;
  config.estimator = EstimatorConfig();  // which calibrates nothing
  CameraExtrinsics extrinsics = dataset.extrinsics;
  extrinsics.time_offset_s = -1e-9 * static_cast<double>(late_ns);
  Pipeline pipeline(config, {dataset.camera, extrinsics, dataset.imu_noise}, dataset.ground_truth);
  return told_of_first_images(pipeline, dataset, late_ns);
}

TEST(Pipeline, WhereTheDroneWasIsToldByTheClockOfTheImu) {
  const std::vector<Odometry> exact = flown_with_late_stamps(0);
  const std::vector<Odometry> late = flown_with_late_stamps(8'000'000);
  ASSERT_GT(exact.size(), 5U);
  ASSERT_EQ(late.size(), exact.size());
  for (std::size_t i = 0; i < exact.size(); ++i) {
    EXPECT_EQ(late[i].stamp_ns, exact[i].stamp_ns);
    EXPECT_EQ(late[i].pose.p_world_imu, exact[i].pose.p_world_imu);
  }
}

// The state stays where the IMU has carried it, and the drone does not.
TEST(Pipeline, OfImagesThatTheImuDoesNotReachNothingIsTold) {
  Drone drone("uav0", FlightMode::kSolo);
  for (std::size_t i = 0; i < 10; ++i) (void)drone.fly(i);
  ASSERT_TRUE(drone.pipeline().started());
  for (std::size_t i = 10; i < 40; ++i) {
    EXPECT_FALSE(drone.fly_without_imu(i).odometry);
  }
  EXPECT_EQ(drone.pipeline().status().status, FilterStatus::kDegraded);
}

// Who waits for a scene takes to the air unnoticed.
TEST(Pipeline, ADroneStartsWhileItsCameraIsBlind) {
  Drone drone("uav0", FlightMode::kSolo, ExchangeMode::kCompact, {}, ThermalMode::kCalibrated);
  for (std::size_t i = 0; i < 10; ++i)
    ASSERT_EQ(drone.fly_blind(i).content, ImageContent::kUniform);
  EXPECT_TRUE(drone.pipeline().started());
  EXPECT_TRUE(drone.fly_blind(10).odometry);
  for (std::size_t i = 11; i < drone.images(); ++i) (void)drone.fly(i);
  EXPECT_EQ(drone.pipeline().status().status, FilterStatus::kTracking);
}

TEST(Pipeline, NobodyStartsBeforeTheImuBegins) {
  Drone drone("uav0", FlightMode::kSolo);
  drone.lose_imu_before(3);
  for (std::size_t i = 0; i < 3; ++i) {
    (void)drone.fly(i);
    EXPECT_FALSE(drone.pipeline().started()) << i;
  }
  EXPECT_EQ(drone.pipeline().not_started(), "its IMU has not begun by this image");
  (void)drone.fly(3);
  EXPECT_TRUE(drone.pipeline().started());
}

std::set<std::uint64_t> lasting_tracks(const TrackedFrame& frame) {
  std::set<std::uint64_t> tracks;
  for (const TrackedFeature& feature : frame.features) {
    if (feature.length > 10) tracks.insert(feature.track_id);
  }
  return tracks;
}

// The first image after them is looked for where the turn since the last scene has moved it.
TEST(Pipeline, AfterBlindImagesTracksAreFoundAsAfterImagesThatNeverCame) {
  constexpr std::size_t kLastSeen = 29, kSeesAgain = 34;
  const auto make = [] {
    return Drone("uav0", FlightMode::kSolo, ExchangeMode::kCompact, {}, ThermalMode::kCalibrated);
  };
  Drone blind = make(), late = make();
  for (std::size_t i = 0; i <= kLastSeen; ++i) {
    (void)blind.fly(i);
    (void)late.fly(i);
  }
  for (std::size_t i = kLastSeen + 1; i < kSeesAgain; ++i) (void)blind.fly_blind(i);
  const std::set<std::uint64_t> found = lasting_tracks(blind.fly(kSeesAgain).frame);
  const std::set<std::uint64_t> expected = lasting_tracks(late.fly(kSeesAgain).frame);
  ASSERT_GT(expected.size(), 30U);
  std::vector<std::uint64_t> both;
  std::set_intersection(found.begin(), found.end(), expected.begin(), expected.end(),
                        std::back_inserter(both));
  EXPECT_GT(both.size(), 0.95 * static_cast<double>(expected.size()));
}

TEST(Pipeline, AloneItAsksNobodyAndAnswersNobody) {
  Drone drone("uav0", FlightMode::kSolo);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_FALSE(drone.fly(i).advert);
  EXPECT_FALSE(drone.pipeline().answer(PlaceAdvert()));
  EXPECT_EQ(drone.pipeline().fuse(PeerKeyframe()).outcome, PeerOutcome::kRejected);
  EXPECT_FALSE(drone.pipeline().collaboration());
}

// uav0 and uav1, side by side. Who asks per view asks about each keyframe.
struct TwoDrones {
  explicit TwoDrones(ExchangeMode ones = ExchangeMode::kCompact,
                     ExchangeMode others = ExchangeMode::kCompact)
      : one("uav0", FlightMode::kCollaborative, ones, {0, 0, 0}),
        other("uav1", FlightMode::kCollaborative, others) {}

  // Shows `on_question` each image of uav0's about which it asks; how many those are.
  template <typename OnQuestion>
  int fly(const OnQuestion& on_question) {
    int asked = 0;
    for (std::size_t i = 0; i < one.images(); ++i) {
      const ImageResult mine = one.fly(i);
      (void)other.fly(i);
      if (!mine.advert) continue;
      ++asked;
      on_question(mine);
    }
    return asked;
  }
  // Shows `on_answer` what uav1 answers.
  template <typename OnAnswer>
  void fly_answered(const OnAnswer& on_answer) {
    fly([&](const ImageResult& mine) {
      const auto answer = other.pipeline().answer(*mine.advert);
      if (answer) on_answer(*answer);
    });
  }

  Drone one, other;
};

TEST(Pipeline, TwoDronesAskAndAnswerWithoutAnyNetwork) {
  TwoDrones drones;
  Pipeline &one = drones.one.pipeline(), &other = drones.other.pipeline();
  int answered = 0;
  const int asked = drones.fly([&](const ImageResult& mine) {
    EXPECT_GT(mine.timing.describe_ms, 0);
    const auto answer = other.answer(*mine.advert);
    if (!answer) return;
    ++answered;
    EXPECT_EQ(answer->receiver, "uav0");
    (void)one.fuse(*answer);
  });
  EXPECT_GT(asked, 0);
  EXPECT_GT(answered, 0);
  EXPECT_EQ(one.collaboration()->keyframes, asked);
  EXPECT_EQ(one.collaboration()->keyframes_received, answered);
  EXPECT_EQ(other.collaboration()->adverts_received, asked);
}

TEST(Pipeline, WhoAnswersHearsWhatCameOfIt) {
  TwoDrones drones;
  Pipeline &one = drones.one.pipeline(), &other = drones.other.pipeline();
  int fused = 0, learned = 0;
  drones.fly_answered([&](const PeerKeyframe& answer) {
    PeerResult result = one.fuse(answer);
    EXPECT_EQ(result.outcome == PeerOutcome::kFused, result.reply.has_value());
    if (!result.reply) return;
    ++fused;
    EXPECT_EQ(result.reply->receiver, "uav1");
    EXPECT_EQ(result.reply->found->keyframe_id, answer.pose.keyframe_id);
    PeerKeyframe invented = *result.reply;
    invented.found.value().keyframe_id += 1000;
    EXPECT_EQ(other.fuse(invented).outcome, PeerOutcome::kRejected);
    invented = *result.reply;
    invented.sender = "uav2";
    EXPECT_EQ(other.fuse(invented).outcome, PeerOutcome::kRejected) << "was not answered";
    invented = *result.reply;
    invented.found->T_keyframe_cam.translation().x() = std::nan("");
    EXPECT_EQ(other.fuse(invented).outcome, PeerOutcome::kRejected);
    const PeerResult told = other.fuse(*result.reply);
    EXPECT_FALSE(told.reply) << "nobody answers that";
    learned += told.outcome == PeerOutcome::kFused ? 1 : 0;
  });
  EXPECT_GT(fused, 0);
  EXPECT_GT(learned, 0);
  EXPECT_TRUE(other.team_knowledge()->alignment("uav0"));
}

TEST(Pipeline, NotAboutEachKeyframeIsAsked) {
  Drone drone("uav0", FlightMode::kCollaborative);
  int asked = 0;
  for (std::size_t i = 0; i < drone.images(); ++i) asked += drone.fly(i).advert ? 1 : 0;
  EXPECT_GT(asked, 0);
  EXPECT_LT(asked, drone.pipeline().collaboration()->keyframes);
}

// Its clock too may begin again: ids and stamps alone would pass for an earlier part of the flight.
TEST(Pipeline, OfAPeerWhoseQuestionsCountFromTheBeginningAgainNothingIsKept) {
  TwoDrones drones;
  Pipeline &one = drones.one.pipeline(), &other = drones.other.pipeline();
  const DriftFilter& known = *one.team_knowledge();
  PlaceAdvert question;
  drones.fly([&](const ImageResult& mine) {
    question = *mine.advert;
    if (const auto answer = other.answer(question)) (void)one.fuse(*answer);
  });
  question.sender = "uav1";
  for (const auto& [keyframe_id, is_known] :
       {std::pair(5, true), std::pair(6, true), std::pair(1, false)}) {
    question.keyframe_id = static_cast<std::uint64_t>(keyframe_id);
    (void)one.answer(question);
    EXPECT_EQ(known.alignment("uav1").has_value(), is_known) << keyframe_id;
    if (!is_known) continue;
    PlaceAdvert unusable = question;
    unusable.keyframe_id = 1;
    unusable.vocabulary_hash += 1;
    (void)one.answer(unusable);
    EXPECT_TRUE(known.alignment("uav1")) << "what nobody can answer says nothing";
  }
}

TEST(Pipeline, InThePapersExchangeEveryImageAsksAndAnswersHoldTheFilterOfTheirKeyframe) {
  Drone one("uav0", FlightMode::kCollaborative, ExchangeMode::kPaper);
  Drone other("uav1", FlightMode::kCollaborative, ExchangeMode::kPaper);
  int flown = 0, asked = 0, answered = 0;
  for (std::size_t i = 0; i < one.images(); ++i) {
    const ImageResult mine = one.fly(i);
    (void)other.fly(i);
    if (!mine.odometry) continue;
    ++flown;
    if (!mine.advert) continue;
    ++asked;
    EXPECT_FALSE(mine.announcement);
    auto answer = other.pipeline().answer(*mine.advert);
    if (!answer) continue;
    ++answered;
    const FullPeerKeyframe full = other.pipeline().with_filter(*answer).value();
    EXPECT_EQ(problem_with(full).value_or(""), "");
    EXPECT_EQ(full.filter.stamp_ns, full.keyframe.pose.stamp_ns);
    const bool first = full.keyframe.pose.keyframe_id == 1;  // its filter has seen nothing yet
    EXPECT_GT(full.filter.covariance.rows(), first ? 20 : 100);
    (void)one.pipeline().fuse(full.keyframe);
  }
  EXPECT_GE(asked, flown - 2);  // the filter has to see first
  EXPECT_GT(answered, 0);
  EXPECT_GT(asked, 2 * one.pipeline().collaboration()->keyframes);
}

TEST(Pipeline, InTheNaiveExchangeEveryImageIsToldToAllWithItsFilter) {
  Drone one("uav0", FlightMode::kCollaborative, ExchangeMode::kNaive);
  Drone other("uav1", FlightMode::kCollaborative, ExchangeMode::kNaive);
  int told = 0;
  for (std::size_t i = 0; i < one.images(); ++i) {
    const ImageResult mine = one.fly(i), theirs = other.fly(i);
    EXPECT_FALSE(theirs.advert);
    if (!theirs.announcement) continue;
    ++told;
    EXPECT_EQ(problem_with(*theirs.announcement).value_or(""), "");
    const FilterSnapshot& filter = theirs.announcement->filter;
    EXPECT_EQ(filter.state.head<3>(), theirs.alone->pose.p_world_imu);
    EXPECT_EQ(filter.covariance.topLeftCorner(3, 3),
              theirs.alone->pose_covariance.topLeftCorner(3, 3));
    (void)one.pipeline().fuse(theirs.announcement->keyframe);
  }
  EXPECT_GT(told, 15);
  EXPECT_GT(one.pipeline().collaboration()->matched, 0);
}

TEST(Pipeline, InTheNaiveExchangeQuestionsAreCountedAndNotAnswered) {
  TwoDrones drones(ExchangeMode::kPaper, ExchangeMode::kNaive);
  Pipeline& other = drones.other.pipeline();
  const int asked =
      drones.fly([&](const ImageResult& mine) { EXPECT_FALSE(other.answer(*mine.advert)); });
  EXPECT_GT(asked, 15);
  EXPECT_EQ(other.unexpected_questions(), asked);
  PeerKeyframe answer;
  answer.pose.keyframe_id = 1;
  EXPECT_FALSE(other.with_filter(answer)) << "it has kept none";
}

std::string complaint_about(const std::string& vocabulary) {
  AgentConfig config;
  config.agent.name = "uav0";
  config.agent.vocabulary = vocabulary;
  const Dataset dataset = test_flight();
  try {
    const Pipeline pipeline(config, {dataset.camera, dataset.extrinsics, dataset.imu_noise},
                            dataset.ground_truth);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(Pipeline, TakesTheVocabularyThatItIsTold) {
  EXPECT_EQ(complaint_about("thermal"), "");
  EXPECT_THAT(complaint_about("no/such/words.txt"), ::testing::HasSubstr("no/such/words.txt"));
}

// Where the honest answer, which comes right after it, is taken.
TEST(Pipeline, AHostileMessageIsRejected) {
  TwoDrones drones;
  Pipeline& one = drones.one.pipeline();
  int fused = 0;
  drones.fly_answered([&](const PeerKeyframe& answer) {
    PeerKeyframe hostile = answer;
    hostile.landmarks.front().inverse_depth = std::nan("");
    EXPECT_EQ(one.fuse(hostile).outcome, PeerOutcome::kRejected);
    if (one.fuse(answer).outcome == PeerOutcome::kFused) ++fused;
  });
  EXPECT_GT(fused, 0);
}

}  // namespace
}  // namespace covey
