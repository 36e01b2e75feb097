// SPDX-License-Identifier: Apache-2.0
#include "frontend/photometric_calibration.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "estimator/median.h"
#include "frontend/patch_alignment.h"
#include "frontend/white_level.h"

namespace covey {
namespace {

// Calibrated levels: the first image's mean in the middle, its deviation this many levels.
constexpr double kLevelsPerSigma = 128;
constexpr int kMiddle = ToneCurve::kLevels / 2;
constexpr int kSampleStep = 8;  // px, between the pixels that stand for the whole image

int pixel(const cv::Mat& image, int y, int x) {
  return image.depth() == CV_8U ? image.at<std::uint8_t>(y, x) : image.at<std::uint16_t>(y, x);
}

// Mean of a track's patch, grey levels, warped with it: when the camera comes nearer, the mean of
// a square of the image is that of less of the scene, which looks like a change of gain. Nothing at
// the image's edge, nor where a pixel has no value of its own: black, `white`, or all equal.
template <typename Pixel>
std::optional<double> patch_grey(const cv::Mat& image, int white, const PatchPlace& place,
                                 int radius_px) {
  if (!inside(image, place, radius_px)) return std::nullopt;
  const Eigen::Vector2d lowest = place.pixel - radius_px * place.affine.cwiseAbs().rowwise().sum();
  const Eigen::Vector2f step = place.affine.col(0).cast<float>();
  float sum = 0;  // of what differs from the first pixel
  Pixel least = std::numeric_limits<Pixel>::max(), most = 0;
  const float base = image.at<Pixel>(static_cast<int>(lowest.y()), static_cast<int>(lowest.x()));
  const int side_px = 2 * radius_px + 1;
  for (int v = -radius_px; v <= radius_px; ++v) {
    Eigen::Vector2f p =
        (place.pixel + place.affine * Eigen::Vector2d(-radius_px, v)).template cast<float>();
    for (int u = 0; u < side_px; ++u, p += step) {
      const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
      const float fx = p.x() - static_cast<float>(x), fy = p.y() - static_cast<float>(y);
      const Pixel* above = image.ptr<Pixel>(y) + x;
      const Pixel* below = image.ptr<Pixel>(y + 1) + x;
      const float grey = (1 - fy) * ((1 - fx) * above[0] + fx * above[1]) +
                         fy * ((1 - fx) * below[0] + fx * below[1]) - base;
      sum += grey;
      least = std::min(least, above[0]);
      most = std::max(most, above[0]);
    }
  }
  if (least == most || least == 0 || most >= white) return std::nullopt;
  return base + sum / static_cast<float>(side_px * side_px);
}

template <typename Pixel>
void look_up(const cv::Mat& image, const std::vector<std::int16_t>& table, const cv::Mat& bias,
             const std::array<std::uint8_t, ToneCurve::kLevels>& tone, cv::Mat& out) {
  for (int y = 0; y < image.rows; ++y) {
    const Pixel* in = image.ptr<Pixel>(y);
    const auto* field = bias.ptr<std::int16_t>(y);
    auto* grey = out.ptr<std::uint8_t>(y);
    for (int x = 0; x < image.cols; ++x) {
      const int level = table[in[x]] - field[x];
      grey[x] = tone[static_cast<std::size_t>(std::clamp(level, 0, ToneCurve::kLevels - 1))];
    }
  }
}

template <typename Pixel>
void look_up_sensor(const cv::Mat& image, const std::vector<std::int16_t>& table, int white,
                    cv::Mat& levels) {
  for (int y = 0; y < image.rows; ++y) {
    const Pixel* in = image.ptr<Pixel>(y);
    auto* out = levels.ptr<std::int16_t>(y);
    for (int x = 0; x < image.cols; ++x) {
      const bool saturated = in[x] == 0 || in[x] >= white;
      out[x] = saturated ? StripePattern::kNoLevel : table[in[x]];
    }
  }
}

// By how much blocks have moved, px.
double median_travel(const std::vector<FieldDifference>& blocks) {
  std::vector<double> travels;
  travels.reserve(blocks.size());
  for (const FieldDifference& block : blocks) travels.push_back((block.to - block.from).norm());
  return travels.empty() ? 0 : median(std::move(travels));
}

// By how much tracks have moved, px; nothing where none is in both.
std::optional<double> median_travel(const std::vector<TrackGrey>& before,
                                    const std::vector<TrackGrey>& now) {
  std::vector<double> travels;
  for (const TrackGrey& track : now) {
    const auto same = std::lower_bound(
        before.begin(), before.end(), track,
        [](const TrackGrey& a, const TrackGrey& b) { return a.patch_id < b.patch_id; });
    if (same == before.end() || same->patch_id != track.patch_id) continue;
    travels.push_back((track.pixel - same->pixel).norm());
  }
  if (travels.empty()) return std::nullopt;
  return median(std::move(travels));
}

struct GreyStatistics {
  double mean = 0, deviation = 0;
};

// The outermost pixels count as the outermost of the others: a hot pixel of 16 bits would say more
// than the whole scene. `greys` must not be empty; their order is lost.
GreyStatistics winsorised(std::vector<int>& greys) {
  constexpr std::size_t kOutermost = 100;  // one in so many, at either end
  const std::size_t outermost = (greys.size() + kOutermost - 1) / kOutermost;
  const auto cut = static_cast<std::ptrdiff_t>(std::min(outermost, (greys.size() - 1) / 2));
  const auto low = greys.begin() + cut, high = greys.end() - 1 - cut;
  std::nth_element(greys.begin(), low, greys.end());
  const double least = *low;
  std::nth_element(low, high, greys.end());
  const double most = *high;
  double sum = 0, squares = 0;
  for (const int grey : greys) {
    const double counted = std::clamp(static_cast<double>(grey), least, most) - least;
    sum += counted;
    squares += counted * counted;
  }
  const auto count = static_cast<double>(greys.size());
  const double mean = sum / count;
  return {least + mean, std::sqrt(std::max(0.0, squares / count - mean * mean))};
}

// px, between the pixels that tell mean and deviation of the whole image
int statistics_step(const cv::Mat& image) {
  constexpr double kPixels = 1280;
  return std::max(1, cvRound(std::sqrt(static_cast<double>(image.total()) / kPixels)));
}

// Calls visit(x, y, grey) for pixels from all over the image that are not saturated.
template <typename Visit>
void for_each_sample(const cv::Mat& image, int white, int step, const Visit& visit) {
  for (int y = step / 2; y < image.rows; y += step) {
    for (int x = step / 2; x < image.cols; x += step) {
      const int grey = pixel(image, y, x);
      if (grey > 0 && grey < white) visit(x, y, grey);
    }
  }
}

// Of the pixels that are not saturated.
GreyStatistics unsaturated(const cv::Mat& image, int white) {
  std::vector<int> greys;
  for_each_sample(image, white, statistics_step(image),
                  [&](int, int, int grey) { greys.push_back(grey); });
  if (greys.empty()) return {0, 1};
  constexpr double kLeastDeviation = 0.25;  // grey levels
  GreyStatistics statistics = winsorised(greys);
  statistics.deviation = std::max(kLeastDeviation, statistics.deviation);
  return statistics;
}

// A chain that has gone astray squeezes the image into few levels, or pushes it out of their range.
bool plausible(std::vector<int> levels, const ChainConfig& chain) {
  if (levels.empty()) return true;
  const auto [mean, deviation] = winsorised(levels);
  return deviation > kLevelsPerSigma / chain.most_stretch &&
         deviation < kLevelsPerSigma * chain.most_stretch &&
         std::abs(mean - kMiddle) < chain.most_shift * kLevelsPerSigma;
}

}  // namespace

PhotometricCalibration::PhotometricCalibration(const PhotometricConfig& config, cv::Size image_size,
                                               const cv::Mat& mask)
    : config_(config),
      shown_(shown_squares(mask, square_side(image_size))),
      shutter_(config.shutter, mask),
      gain_(config.gain),
      field_(config.field, image_size),
      stripes_(config.stripe, image_size),
      pattern_gain_(config.pattern_gain),
      bad_pixels_(config.bad_pixels),
      tone_(config.tone),
      bias_(cv::Mat::zeros(image_size, CV_16SC1)) {}

CalibratedImage PhotometricCalibration::correct(TimeNs stamp_ns, const cv::Mat& image,
                                                const std::vector<TrackPlace>& expected) {
  CalibratedImage result;
  result.content = shutter_.look(stamp_ns, image);
  if (result.content != ImageContent::kScene) {
    blind_ = blind_ || is_blind(result.content);
    image_.release();
    return result;
  }
  const double elapsed_s = stamp_ns_ == 0 ? 0 : seconds_between(stamp_ns_, stamp_ns);
  image_ = image;
  white_ = white_level(image, config_.cut_off_share);
  stamp_ns_ = stamp_ns;
  told_ = blind_ ? std::nullopt : pattern_gain_.measure(image_, white_);
  if (!blind_) {
    result.map =
        config_.temporal ? gain_.estimate(look(expected), field_at(), told_) : gain_.latest();
    build_table(result.map);
  }
  result.restarted = blind_ || !plausible(levels(statistics_step(image)), config_.chain);
  if (result.restarted) {
    restart(image);
    result.map = gain_.latest();
    build_table(result.map);
  }
  result.chain_ns = chain_ns_;
  blind_ = false;
  tone_.adapt(levels(kSampleStep), elapsed_s);
  result.pixels = apply();
  return result;
}

// After the camera looked at its shutter gain, offset and field are others: the chain begins anew,
// with little of a field.
void PhotometricCalibration::restart(const cv::Mat& image) {
  const bool corrected = blind_ && chain_ns_ != 0;
  const double unit_before = sigma_ / gain_.latest().gain;  // grey levels, now
  chain_ns_ = stamp_ns_;
  choose_units(image);
  // The stripes stay what they are in the sensor's own levels. What a chain that has gone astray
  // took for its gain says nothing of them.
  if (corrected) stripes_.scale(static_cast<float>(unit_before / sigma_));
  gain_.restart({});
  field_.reset(corrected ? config_.field.corrected_share : 1);
  stripes_.doubt();
  pattern_gain_.restart(image, white_, 1);
  told_ = std::nullopt;
  seen_.clear();
  looked_.clear();
  last_sight_ = {};
  rebuild_bias();
  tone_.reset();
  refreshed_ns_ = 0;
}

void PhotometricCalibration::choose_units(const cv::Mat& image) {
  const GreyStatistics statistics = unsaturated(image, white_);
  centre_ = statistics.mean;
  sigma_ = statistics.deviation;
}

// What would give the current image the mean and the deviation of the chain's first.
GainOffset PhotometricCalibration::like_the_first() const {
  const GreyStatistics statistics = unsaturated(image_, white_);
  const double gain = sigma_ / statistics.deviation;
  return {gain, centre_ - gain * statistics.mean};
}

std::vector<TrackGrey> PhotometricCalibration::look(const std::vector<TrackPlace>& places) const {
  std::vector<TrackGrey> seen;
  seen.reserve(places.size());
  const int radius_px = config_.gain.patch_radius_px;
  for (const TrackPlace& track : places) {
    const auto grey = image_.depth() == CV_8U
                          ? patch_grey<std::uint8_t>(image_, white_, track.place, radius_px)
                          : patch_grey<std::uint16_t>(image_, white_, track.place, radius_px);
    if (grey) seen.push_back({track.patch_id, track.place.pixel, *grey});
  }
  std::sort(seen.begin(), seen.end(),
            [](const TrackGrey& a, const TrackGrey& b) { return a.patch_id < b.patch_id; });
  return seen;
}

FieldAt PhotometricCalibration::field_at() const {
  return [this](const Eigen::Vector2d& pixel) { return sigma_ * field_.at(pixel); };
}

void PhotometricCalibration::observe(const std::vector<TrackPlace>& tracks) {
  if (image_.empty()) return;
  seen_ = look(tracks);
  if (config_.temporal) {
    gain_.add(stamp_ns_, seen_, field_at(), told_, like_the_first());
    if (config_.pattern) look_at_pattern();
  }
  if (refreshed_ns_ == 0) refreshed_ns_ = stamp_ns_;
  const double since_s = seconds_between(refreshed_ns_, stamp_ns_);
  const bool refreshes = config_.spatial || config_.stripes;
  if (refreshes && since_s >= config_.field.refresh_s) refresh(since_s);
  check_pixels();
}

// Whether the scene has, since the tracks of an earlier look; if so the next one counts from here.
// While nothing is tracked nobody knows.
bool PhotometricCalibration::has_moved(std::vector<TrackGrey>& since, double travel_px) const {
  if (seen_.empty()) return false;
  if (since.empty()) since = seen_;
  const std::optional<double> moved_px = median_travel(since, seen_);
  if (moved_px && *moved_px < travel_px) return false;
  since = seen_;
  return true;
}

// A camera that has corrected itself unnoticed has another pattern.
void PhotometricCalibration::look_at_pattern() {
  if (gain_.contradictions() >= config_.pattern_gain.contradictions) {
    looked_.clear();
    pattern_gain_.restart(image_, white_, gain_.latest().gain);
  }
  if (!has_moved(looked_, config_.pattern_gain.travel_px)) return;
  pattern_gain_.look(image_, white_, gain_.latest().gain);
}

// A small warm thing stands out as well: as long as the scene stands still nothing tells them
// apart.
void PhotometricCalibration::check_pixels() {
  if (checked_ns_ == 0) checked_ns_ = stamp_ns_;
  if (checked_.empty()) checked_ = seen_;
  if (seconds_between(checked_ns_, stamp_ns_) < config_.bad_pixels.interval_s) return;
  if (!has_moved(checked_, config_.bad_pixels.travel_px)) return;
  checked_ns_ = stamp_ns_;
  bad_pixels_.look(image_);
}

// What the field did to the scene since it was last looked at, and the stripes to the image if the
// scene has moved on.
void PhotometricCalibration::refresh(double elapsed_s) {
  refreshed_ns_ = stamp_ns_;
  Sight now = sight();
  const auto found = compare_blocks(last_sight_, now, config_.block);
  if (config_.spatial) field_.update(elapsed_s, found);
  travelled_px_ += median_travel(found);
  if (config_.stripes && travelled_px_ >= config_.stripe.travel_px) {
    travelled_px_ = 0;
    stripes_.look(sensor_levels());
  }
  last_sight_ = std::move(now);
  rebuild_bias();
}

void PhotometricCalibration::rebuild_bias() {
  bias_ = field_.image(kLevelsPerSigma);
  stripes_.add_to(bias_);
}

// Calibrated levels with field and stripes still in them.
cv::Mat PhotometricCalibration::sensor_levels() const {
  cv::Mat levels(image_.size(), CV_16SC1);
  if (image_.depth() == CV_8U) {
    look_up_sensor<std::uint8_t>(image_, table_, white_, levels);
  } else {
    look_up_sensor<std::uint16_t>(image_, table_, white_, levels);
  }
  return levels;
}

// The current image as the field is looked for in it.
Sight PhotometricCalibration::sight() const {
  const int side_px = square_side(image_.size());
  Sight sight{side_px, square_means(image_, white_, side_px, shown_), seen_};
  for (const cv::Point& bad : bad_pixels_.found()) {
    const cv::Point square = bad / side_px;
    if (square.x >= sight.levels.cols || square.y >= sight.levels.rows) continue;
    sight.levels.at<float>(square) = std::numeric_limits<float>::quiet_NaN();
  }
  const GainOffset& map = gain_.latest();
  sight.levels.convertTo(sight.levels, CV_32F, map.gain / sigma_, (map.offset - centre_) / sigma_);
  return sight;
}

void PhotometricCalibration::build_table(const GainOffset& map) {
  const double scale = kLevelsPerSigma / sigma_;
  const double gain = scale * map.gain;
  const double offset = scale * (map.offset - centre_) + kMiddle + 0.5;
  table_.resize(image_.depth() == CV_8U ? 256 : 65536);
  constexpr double kEnd = 2.0 * ToneCurve::kLevels;  // leaves room for the field
  for (std::size_t grey = 0; grey < table_.size(); ++grey) {
    const double level = gain * static_cast<double>(grey) + offset;
    table_[grey] = static_cast<std::int16_t>(std::clamp(level, -kEnd, kEnd));
  }
}

// Calibrated levels of pixels from all over the image that are not saturated.
std::vector<int> PhotometricCalibration::levels(int step) const {
  std::vector<int> sample;
  for_each_sample(image_, white_, step, [&](int x, int y, int grey) {
    const int level = table_[static_cast<std::size_t>(grey)] - bias_.at<std::int16_t>(y, x);
    sample.push_back(std::clamp(level, 0, ToneCurve::kLevels - 1));
  });
  return sample;
}

cv::Mat PhotometricCalibration::apply() const {
  cv::Mat grey(image_.size(), CV_8UC1);
  if (image_.depth() == CV_8U) {
    look_up<std::uint8_t>(image_, table_, bias_, tone_.table(), grey);
  } else {
    look_up<std::uint16_t>(image_, table_, bias_, tone_.table(), grey);
  }
  bad_pixels_.replace(grey);
  return grey;
}

cv::Mat PhotometricCalibration::field() const {
  cv::Mat field;
  field_.image(kLevelsPerSigma).convertTo(field, CV_32F, sigma_ / kLevelsPerSigma);
  return field;
}

std::vector<PatchLevel> PhotometricCalibration::patch_levels() const {
  const FieldAt field = field_at();
  std::vector<PatchLevel> levels;
  levels.reserve(seen_.size());
  for (const TrackGrey& seen : seen_) {
    levels.push_back({seen.patch_id, seen.grey, map()(seen.grey) - field(seen.pixel)});
  }
  return levels;
}

}  // namespace covey
