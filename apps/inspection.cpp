// SPDX-License-Identifier: Apache-2.0
#include "apps/inspection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "apps/image_reader.h"
#include "apps/stop_signal.h"
#include "estimator/median.h"

namespace covey {
namespace {

constexpr std::size_t kHistogramInterval = 10;  // images between two that are counted
constexpr std::size_t kResidualLag = 10;        // images between two sights of a patch
constexpr double kFieldInterval_s = 0.5;

AgentConfig alone(AgentConfig config, ThermalMode mode, bool has_truth) {
  config.agent.mode = FlightMode::kSolo;
  config.thermal.mode = mode;
  if (!has_truth) config.initialisation.method = InitMethod::kStatic;
  return config;
}

// One flight, and what is kept of it.
class Observer {
 public:
  Observer(const AgentConfig& config, const Dataset& dataset)
      : pipeline_(config, sensors_of(dataset), dataset.ground_truth), dataset_(dataset) {}

  ImageResult fly(TimeNs stamp_ns, const cv::Mat& pixels) {
    add_imu_for(stamp_ns, dataset_.imu, next_imu_, pipeline_);
    ImageResult result = pipeline_.add_image(stamp_ns, pixels);
    keep(result);
    return result;
  }

  void take_picture(const ImageResult& newest) {
    flight_.pictures.push_back(picture_of(newest, pipeline_));
  }
  void count_corners() { flight_.corners.add(pipeline_.tracked_image()); }

  [[nodiscard]] const PhotometricCalibration* calibration() const {
    return pipeline_.calibration();
  }
  [[nodiscard]] std::optional<double> pixel_lag_s() const { return pipeline_.pixel_lag_s(); }

  [[nodiscard]] InspectedFlight finished() {
    if (!flight_.tracks.empty()) {
      flight_.mean_tracks = sightings_ / static_cast<double>(flight_.tracks.size());
    }
    if (begun_ > 0) flight_.mean_length = sightings_ / begun_;
    return std::move(flight_);
  }

 private:
  void keep(const ImageResult& result) {
    const TimeNs stamp_ns = result.timing.stamp_ns;
    if (result.content == ImageContent::kUniform) {
      ++flight_.uniform_images;
    } else if (result.content != ImageContent::kScene) {
      ++flight_.repeated_images;
    }
    if (result.update.reinitialized) ++flight_.filter_restarts;
    if (result.content == ImageContent::kScene) {
      const auto tracks = static_cast<double>(result.frame.features.size());
      flight_.tracks.emplace_back(seconds_between(dataset_.images.front().stamp_ns, stamp_ns),
                                  tracks);
      sightings_ += tracks;
      begun_ += static_cast<double>(result.tracks_begun);
    }
    if (result.odometry) flight_.path.push_back({result.odometry->stamp_ns, result.odometry->pose});
  }

  Pipeline pipeline_;
  const Dataset& dataset_;
  std::size_t next_imu_ = 0;
  double sightings_ = 0, begun_ = 0;
  InspectedFlight flight_;
};

// What calibration knew at each image, and how well patches kept their level.
class PhotometricLog {
 public:
  explicit PhotometricLog(std::vector<TimeNs> field_stamps)
      : field_stamps_(std::move(field_stamps)) {}

  void add(const ImageResult& result, const cv::Mat& pixels,
           const PhotometricCalibration& calibration) {
    if (!result.calibrated || result.content != ImageContent::kScene) return;
    const TimeNs stamp_ns = result.timing.stamp_ns;
    const TimeNs chain_ns = result.calibrated->chain_ns;
    if (result.calibrated->restarted) past_.clear();
    gains_.push_back({stamp_ns, chain_ns, calibration.map()});
    if (calibration.pattern_told()) ++told_;
    compare_patches(calibration, pixels);
    if (!field_is_due(stamp_ns)) return;
    // Half an hour of them as large as images would be 5 GB; comparing takes no more than this.
    if (!fields_.empty()) fields_.back().field = in_truth_cells(fields_.back().field);
    fields_.push_back({stamp_ns, chain_ns, calibration.field()});
  }

  void move_into(Inspection& inspection) {
    if (!gains_.empty()) {
      inspection.pattern_share = static_cast<double>(told_) / static_cast<double>(gains_.size());
    }
    inspection.gains = std::move(gains_);
    inspection.fields = std::move(fields_);
    if (raw_residuals_.empty()) return;
    inspection.raw_residual = median(std::move(raw_residuals_));
    inspection.calibrated_residual = median(std::move(calibrated_residuals_));
  }

 private:
  bool field_is_due(TimeNs stamp_ns) {
    if (!field_stamps_.empty()) {
      return std::binary_search(field_stamps_.begin(), field_stamps_.end(), stamp_ns);
    }
    if (stamp_ns < next_field_ns_) return false;
    next_field_ns_ = stamp_ns + nanoseconds(kFieldInterval_s);
    return true;
  }

  using Patches = std::unordered_map<std::uint64_t, PatchLevel>;

  void compare_patches(const PhotometricCalibration& calibration, const cv::Mat& pixels) {
    cv::Scalar mean, deviation;
    cv::meanStdDev(pixels, mean, deviation);
    const double gain = calibration.map().gain;
    Patches now;
    for (const PatchLevel& level : calibration.patch_levels()) now[level.patch_id] = level;
    if (past_.size() == kResidualLag && deviation[0] > 0) {
      for (const auto& [patch, before] : past_.back()) {
        const auto found = now.find(patch);
        if (found == now.end()) continue;
        const PatchLevel& levels = found->second;
        raw_residuals_.push_back(std::abs(levels.raw - before.raw) / deviation[0]);
        calibrated_residuals_.push_back(std::abs(levels.calibrated - before.calibrated) /
                                        (gain * deviation[0]));
      }
    }
    past_.push_front(std::move(now));
    if (past_.size() > kResidualLag) past_.pop_back();
  }

  std::vector<TimeNs> field_stamps_;  // InspectionConfig
  TimeNs next_field_ns_ = 0;
  std::vector<PhotometricRecord> gains_;
  int told_ = 0;  // of them, by the sensor's pattern
  std::vector<FieldRecord> fields_;
  std::deque<Patches> past_;  // newest first
  std::vector<double> raw_residuals_, calibrated_residuals_;
};

}  // namespace

void CornerHistogram::add(const cv::Mat& grey) {
  constexpr int kBlock = 3, kAperture = 3;
  constexpr double kHarris = 0.04;
  cv::Mat response;
  cv::cornerHarris(grey, response, kBlock, kAperture, kHarris);
  ++images;
  for (double& mean : shares) mean -= mean / static_cast<double>(images);
  const double share = 1 / (static_cast<double>(response.total()) * static_cast<double>(images));
  for (int y = 0; y < response.rows; ++y) {
    const auto* row = response.ptr<float>(y);
    for (int x = 0; x < response.cols; ++x) {
      if (!(row[x] > 0)) continue;
      const double place = (std::log10(row[x]) - kLowest) / (kHighest - kLowest);
      const int bin = static_cast<int>(std::floor(place * kBins));
      if (bin >= 0 && bin < kBins) shares[static_cast<std::size_t>(bin)] += share;
    }
  }
}

double CornerHistogram::middle(int bin) {
  return kLowest + (bin + 0.5) * (kHighest - kLowest) / kBins;
}

std::vector<CornerRecord> corner_records(const CornerHistogram& raw,
                                         const CornerHistogram& calibrated) {
  std::vector<CornerRecord> records;
  for (int bin = 0; bin < CornerHistogram::kBins; ++bin) {
    const auto i = static_cast<std::size_t>(bin);
    records.push_back({CornerHistogram::middle(bin), raw.shares[i], calibrated.shares[i]});
  }
  return records;
}

Picture picture_of(const ImageResult& newest, Pipeline& pipeline) {
  Picture picture{newest.timing.stamp_ns, pipeline.tracked_image().clone(), {}};
  const std::vector<TrackKind> kinds = pipeline.kinds(newest.frame);
  for (std::size_t i = 0; i < kinds.size(); ++i)
    picture.tracks.push_back({newest.frame.features[i].pixel, kinds[i]});
  return picture;
}

std::vector<std::size_t> picture_indices(std::size_t images, int pictures) {
  std::vector<std::size_t> indices;
  const auto parts = static_cast<std::size_t>(pictures) + 1;
  for (std::size_t i = 1; i < parts; ++i) indices.push_back(images * i / parts);
  return indices;
}

Inspection inspect_flight(const DroneFolder& drone, const InspectionConfig& config,
                          const OnImage& show) {
  Inspection inspection;
  inspection.dataset = read_recording(drone.mav0);
  // So that raw images are flown with the same settings as calibrated ones.
  inspection.dataset.thermal =
      is_thermal_camera(config.agent.thermal.mode, inspection.dataset.thermal);
  const Dataset& dataset = inspection.dataset;
  const bool has_truth = dataset.ground_truth.has_value();
  Observer raw(alone(config.agent, ThermalMode::kRaw, has_truth), dataset);
  std::optional<Observer> calibrated;
  if (is_calibrated(config.agent.thermal.mode, dataset.thermal)) {
    calibrated.emplace(alone(config.agent, ThermalMode::kCalibrated, has_truth), dataset);
  }
  ImageReader reader(dataset.camera);
  PhotometricLog log(config.field_stamps);
  const auto pictured = picture_indices(dataset.images.size(), config.pictures);
  std::size_t next_picture = 0;
  for (std::size_t i = 0; i < dataset.images.size(); ++i) {
    if (stop_requested()) throw std::runtime_error("inspect: interrupted, nothing is written");
    show(i, dataset.images.size());
    const ImageEntry& image = dataset.images[i];
    const std::optional<cv::Mat> pixels = reader.read(image);
    if (!pixels) continue;
    const ImageResult raw_result = raw.fly(image.stamp_ns, *pixels);
    std::optional<ImageResult> result;
    if (calibrated) result = calibrated->fly(image.stamp_ns, *pixels);
    const bool scene = (result ? *result : raw_result).content == ImageContent::kScene;
    if (result) log.add(*result, *pixels, *calibrated->calibration());
    if (!scene) continue;
    if (i % kHistogramInterval == 0) {
      raw.count_corners();
      if (calibrated) calibrated->count_corners();
    }
    // A moment at which the camera does not see is pictured as soon as it does.
    if (next_picture < pictured.size() && i >= pictured[next_picture]) {
      ++next_picture;
      raw.take_picture(raw_result);
      if (calibrated) calibrated->take_picture(*result);
    }
  }
  show(dataset.images.size(), dataset.images.size());
  inspection.raw = raw.finished();
  if (calibrated) {
    inspection.calibrated = calibrated->finished();
    inspection.pixel_lag_s = calibrated->pixel_lag_s();
  }
  inspection.left_out = reader.left_out();
  log.move_into(inspection);
  return inspection;
}

}  // namespace covey
