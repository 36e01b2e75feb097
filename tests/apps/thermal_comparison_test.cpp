// SPDX-License-Identifier: Apache-2.0
#include "apps/thermal_comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <string>

#include "apps/png_file.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

constexpr double kPeriod_s = 0.1;

// Four seconds of automatic gain, and what a calibration says that knows it all.
struct KnownFlight {
  std::vector<ThermalTruthRecord> truth;
  std::vector<PhotometricRecord> gains;
};

KnownFlight known_flight() {
  KnownFlight flight;
  const TimeNs chain_ns = nanoseconds(1);
  for (int i = 0; i < 40; ++i) {
    const TimeNs stamp_ns = chain_ns + nanoseconds(i * kPeriod_s);
    const double black_k = 280 + std::sin(0.3 * i), white_k = 292 + 2 * std::cos(0.2 * i);
    flight.truth.push_back({stamp_ns, black_k, white_k, false, {}});
    const double first_k = flight.truth[0].white_k - flight.truth[0].black_k;
    flight.gains.push_back(
        {stamp_ns,
         chain_ns,
         {(white_k - black_k) / first_k, (black_k - flight.truth[0].black_k) * 255 / first_k}});
  }
  return flight;
}

TEST(ThermalComparison, ACalibrationThatKnowsTheTruthHasNoError) {
  const KnownFlight flight = known_flight();
  const ThermalComparison compared = compare_with_truth(flight.gains, {}, flight.truth, {});
  ASSERT_TRUE(compared.third && compared.second && compared.chain);
  EXPECT_LT(compared.third->worst, 1e-12);
  EXPECT_LT(compared.second->worst, 1e-12);
  EXPECT_LT(compared.chain->worst, 1e-12);
  EXPECT_LT(compared.within_chain->worst, 1e-12);
  EXPECT_FALSE(compared.field_rms.has_value());
  EXPECT_NEAR(compared.true_gains[7].map.offset, flight.gains[7].map.offset, 1e-9);
}

TEST(ThermalComparison, ADriftingGainIsWrongByWhatItDriftsInTheTimeBetween) {
  KnownFlight flight = known_flight();
  for (std::size_t i = 0; i < flight.gains.size(); ++i) {
    flight.gains[i].map.gain *= std::pow(1.002, static_cast<double>(i));
  }
  const ThermalComparison compared = compare_with_truth(flight.gains, {}, flight.truth, {});
  EXPECT_NEAR(compared.second->mean, std::pow(1.002, 10) - 1, 1e-9) << "ten images";
  EXPECT_NEAR(compared.third->mean, std::pow(1.002, 4) - 1, 1e-9) << "the fourth is old enough";
  EXPECT_NEAR(compared.chain->worst, std::pow(1.002, 39) - 1, 1e-9);
}

// Two chains, whose gains are all told a factor too large, and scatter by so much to either side.
KnownFlight scaled_flight(double factor, double scatter) {
  KnownFlight flight = known_flight();
  const std::vector<PhotometricRecord> known = flight.gains;
  for (std::size_t i = 0; i < known.size(); ++i) {
    const PhotometricRecord& first = known[i < 10 ? 0 : 10];
    flight.gains[i].chain_ns = first.stamp_ns;
    flight.gains[i].map.gain =
        known[i].map.gain / first.map.gain * factor * std::exp(i % 2 == 0 ? scatter : -scatter);
  }
  return flight;
}

TEST(ThermalComparison, WithinAChainOneFactorIsFree) {
  const KnownFlight scaled = scaled_flight(1.3, 0), scattered = scaled_flight(1.3, 0.02);
  const ThermalComparison compared = compare_with_truth(scaled.gains, {}, scaled.truth, {});
  EXPECT_NEAR(compared.chain->worst, 0.3, 1e-9);
  EXPECT_LT(compared.within_chain->worst, 1e-12);
  EXPECT_NEAR(compare_with_truth(scattered.gains, {}, scattered.truth, {}).within_chain->mean, 0.02,
              1e-3);
}

TEST(ThermalComparison, ImagesOfTwoChainsAreNotCompared) {
  KnownFlight flight = known_flight();
  for (std::size_t i = 0; i < flight.gains.size(); ++i) {
    PhotometricRecord& record = flight.gains[i];
    record.chain_ns = record.stamp_ns;  // every image restarts
    record.map = {};
  }
  const ThermalComparison compared = compare_with_truth(flight.gains, {}, flight.truth, {});
  EXPECT_FALSE(compared.third || compared.second || compared.chain || compared.within_chain);
}

TEST(ThermalComparison, OneImageIsComparedWithNone) {
  KnownFlight flight = known_flight();
  flight.gains.resize(1);
  const ThermalComparison compared = compare_with_truth(flight.gains, {}, flight.truth, {});
  EXPECT_FALSE(compared.third || compared.second || compared.chain);
  EXPECT_EQ(compared.true_gains.size(), 1U);
}

TEST(ThermalComparison, TemperaturesAsTheyAreHaveAGainOfOne) {
  KnownFlight flight = known_flight();
  for (PhotometricRecord& record : flight.gains) record.map = {};
  const ThermalComparison compared = compare_with_truth(flight.gains, {}, flight.truth, 0.01);
  EXPECT_EQ(compared.chain->worst, 0);
}

// A true field that rises to the right, and what is left of it.
ThermalComparison compare_field(const TemporaryFolder& folder, double gain, double constant_k) {
  KnownFlight flight = known_flight();
  const cv::Size size(64, 48);
  cv::Mat pattern_k(size, CV_32FC1);
  for (int x = 0; x < size.width; ++x) pattern_k.col(x).setTo(0.01 * x);
  ThermalTruth truth{280, 290, pattern_k, false};
  ThermalTruthWriter writer(folder.path());
  const ThermalTruthRecord& last = flight.truth.back();
  writer.write(last.stamp_ns, truth);
  writer.close();
  flight.truth.back().field = (*read_thermal_truth(folder.path()))[0].field;
  const double level_k = (flight.truth[0].white_k - flight.truth[0].black_k) / 255;
  const cv::Mat field = (gain * pattern_k + constant_k) / level_k;
  return compare_with_truth(flight.gains, {{last.stamp_ns, flight.truth[0].stamp_ns, field}},
                            flight.truth, {});
}

TEST(ThermalComparison, AFieldIsAsWrongAsItsDifferenceFromTheTrueOneWithoutItsMean) {
  const TemporaryFolder folder;
  EXPECT_LT(*compare_field(folder, 1, 0.5).field_rms, 5e-3) << "the file holds millikelvins";
  EXPECT_NEAR(*compare_field(folder, 0.7, 0).field_rms, 0.3, 5e-3);
  const ThermalComparison nothing = compare_field(folder, 0, 0);
  EXPECT_NEAR(*nothing.field_rms, 1, 5e-3);
  EXPECT_NEAR(*nothing.true_field_k, 0.16 * std::sqrt(1.25), 5e-3) << "four steps of 0.16 K";
}

}  // namespace
}  // namespace covey
