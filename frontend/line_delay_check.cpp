// SPDX-License-Identifier: Apache-2.0
#include "frontend/line_delay_check.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace covey {
namespace {

constexpr std::size_t kApart = 3;        // images, of two that are compared
constexpr std::int64_t kEvery = 5;       // images, one is compared
constexpr double kForgotten = 1.0 / 60;  // of the sums, each time
constexpr std::int64_t kFewest = 40;     // comparisons: the filter's calibration has settled
constexpr double kSurelyKnown = 0.05;    // of a depth, its standard deviation

template <typename Seen>
const Seen* find(const std::vector<Seen>& seen, std::uint64_t track_id) {
  const auto found =
      std::lower_bound(seen.begin(), seen.end(), track_id,
                       [](const Seen& one, std::uint64_t id) { return one.track_id < id; });
  return found != seen.end() && found->track_id == track_id ? &*found : nullptr;
}

}  // namespace

LineDelayCheck::LineDelayCheck(const CameraIntrinsics& camera, double line_delay_s)
    : camera_(camera), line_delay_s_(line_delay_s) {}

LineDelayCheck::View LineDelayCheck::view_of(const TrackedFrame& frame,
                                             const Eigen::Isometry3d& T_world_cam) const {
  View view{frame.stamp_ns, T_world_cam, {}};
  const double middle = 0.5 * (camera_.height - 1);
  for (const TrackedFeature& feature : frame.features) {
    Seen seen{feature.track_id, feature.pixel, std::nullopt};
    const Seen* before = views_.empty() ? nullptr : find(views_.back().seen, feature.track_id);
    if (before) {
      const double elapsed_s = seconds_between(views_.back().stamp_ns, frame.stamp_ns);
      const Eigen::Vector2d flow = (feature.pixel - before->pixel) / elapsed_s;
      seen.late = (feature.pixel.y() - middle) * flow;
    }
    view.seen.push_back(seen);
  }
  std::sort(view.seen.begin(), view.seen.end(),
            [](const Seen& a, const Seen& b) { return a.track_id < b.track_id; });
  return view;
}

void LineDelayCheck::compare(const View& then, const View& now,
                             const std::vector<TrackDepth>& depths) {
  constexpr double kFar_px = 8, kNearest_m = 0.1;
  const Eigen::Isometry3d T_then_now = then.T_world_cam.inverse() * now.T_world_cam;
  for (const TrackDepth& depth : depths) {
    const Seen *here = find(now.seen, depth.track_id), *before = find(then.seen, depth.track_id);
    if (!here || !before || !here->late || !before->late) continue;
    if (!(depth.inverse_depth_sigma < kSurelyKnown * depth.inverse_depth)) continue;
    const auto bearing = unproject(camera_, here->pixel);
    if (!bearing) continue;
    const Eigen::Vector3d p_then = T_then_now * (bearing->homogeneous() / depth.inverse_depth);
    if (!(p_then.z() > kNearest_m)) continue;
    const Eigen::Vector2d off = before->pixel - project(camera_, p_then.hnormalized());
    if (!(off.norm() < kFar_px)) continue;
    const Eigen::Vector2d late = *before->late - *here->late;
    const double weight = 1 / (1 + off.squaredNorm());
    late_late_ += weight * late.squaredNorm();
    late_off_ += weight * late.dot(off);
    off_off_ += weight * off.squaredNorm();
    weight_ += weight;
  }
}

bool LineDelayCheck::is_due() const { return images_ % kEvery == 0; }

void LineDelayCheck::add(const TrackedFrame& frame, const Eigen::Isometry3d& T_world_cam,
                         const std::vector<TrackDepth>& depths) {
  if (!views_.empty() && frame.stamp_ns <= views_.back().stamp_ns) return;
  const bool due = is_due();
  ++images_;
  views_.push_back(view_of(frame, T_world_cam));
  if (views_.size() <= kApart) return;
  const View then = std::move(views_.front());
  views_.pop_front();
  if (!due) return;
  for (double* sum : {&late_late_, &late_off_, &off_off_, &weight_}) *sum *= 1 - kForgotten;
  compare(then, views_.back(), depths);
  ++compared_;
  if (!(late_late_ > 0)) return;
  const double delay_s = late_off_ / late_late_;
  if (is_plain(delay_s)) found_s_ = line_delay_s_ + delay_s;
}

bool LineDelayCheck::is_plain(double delay_s) const {
  constexpr double kLeast_s = 3.5e-3;  // from the first row to the last: less does little harm
  constexpr double kPlainly = 20;      // standard deviations, of errors that last for some images
  const double sigma_s = std::sqrt(off_off_ / weight_ / late_late_);
  return compared_ >= kFewest && std::abs(delay_s) > kPlainly * sigma_s &&
         std::abs(delay_s) * camera_.height > kLeast_s;
}

}  // namespace covey
