// SPDX-License-Identifier: Apache-2.0
#include "apps/import_command.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/bag.h"
#include "apps/camera_pixels.h"
#include "apps/dataset.h"
#include "apps/number_range.h"
#include "apps/png_file.h"
#include "apps/progress.h"
#include "apps/stop_signal.h"
#include "comms/onboard_messages.h"
#include "comms/stamp_order.h"
#include "sim/dataset_writer.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string bag, sensors, image_topic, imu_topic, out;
  std::optional<double> first_stamp_s;
};

using Types = std::vector<std::string>;

bool is_of(const Types& types, const BagTopic& topic) {
  return std::find(types.begin(), types.end(), topic.type) != types.end();
}

std::string names_of(const std::vector<BagTopic>& topics) {
  std::string names;
  for (const BagTopic& topic : topics) names += (names.empty() ? "" : ", ") + topic.name;
  return names.empty() ? "none" : names;
}

// The one that is named, or the only one of its kind. `option`: that names it.
BagTopic choose_topic(const Bag& bag, const Options& options, const std::string& named,
                      const std::string& option, const Types& types) {
  std::vector<BagTopic> fitting;
  std::copy_if(bag.topics().begin(), bag.topics().end(), std::back_inserter(fitting),
               [&](const BagTopic& topic) {
                 return is_of(types, topic) && (named.empty() || topic.name == named);
               });
  if (fitting.size() == 1) return fitting.front();
  if (!named.empty()) {
    throw std::runtime_error(options.bag + ": no topic " + named + " of type " + types.front() +
                             "; topics: " + names_of(bag.topics()));
  }
  if (fitting.empty()) {
    throw std::runtime_error(options.bag + ": no topic of " + types.front() +
                             "; topics: " + names_of(bag.topics()));
  }
  throw std::runtime_error(options.bag + ": several topics of " + types.front() + " (" +
                           names_of(fitting) + "): choose one with " + option);
}

// Packed images are flown where none as the camera took them are there, or where they are named.
BagTopic choose_images(const Bag& bag, const Options& options) {
  const bool any = std::any_of(bag.topics().begin(), bag.topics().end(),
                               [](const BagTopic& topic) { return topic.type == kImageType; });
  const Types types =
      any && options.image_topic.empty() ? Types{kImageType} : Types{kImageType, kPackedImageType};
  return choose_topic(bag, options, options.image_topic, "--image-topic", types);
}

// What was left out, and why: a line for each reason in the end.
class LeftOut {
 public:
  void count(const std::string& reason, std::uint64_t messages = 1) {
    if (messages > 0) counts_[reason] += messages;
  }
  void count(const StampCounts& stamps) {
    count("not newer than the one before", stamps.late);
    count("its stamp is more than a second from those before and after", stamps.wrong);
    count("its clock was set back", stamps.set_back);
  }
  void warn(const std::string& topic) const {
    for (const auto& [reason, count] : counts_)
      spdlog::warn("{}: left out {} of its messages: {}", topic, count, reason);
  }
  // Nothing is left, mostly for the reason that is told.
  [[noreturn]] void fail(const std::string& topic) const {
    const auto most =
        std::max_element(counts_.begin(), counts_.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    const std::string reason = most == counts_.end() ? "it has no message" : most->first;
    throw std::runtime_error(topic + ": nothing of it can be used: " + reason);
  }

 private:
  std::map<std::string, std::uint64_t> counts_;
};

void stop_if_asked() {
  if (stop_requested()) throw std::runtime_error("import: interrupted, nothing has been written");
}

// Nothing, if the image is of the camera's size.
std::optional<std::string> wrong_size(const CameraImage& image, const CameraIntrinsics& camera,
                                      const Options& options) {
  if (image.width == camera.width && image.height == camera.height) return {};
  const auto size = [](int width, int height) {
    return std::to_string(width) + "x" + std::to_string(height);
  };
  return "an image of " + size(image.width, image.height) + ", but " + options.sensors +
         "/cam0/sensor.yaml is of a camera of " + size(camera.width, camera.height);
}

// By how much stamps are moved. Stamps below zero are none.
TimeNs shift_of(const Options& options, TimeNs first_image_ns, TimeNs first_imu_ns) {
  if (!options.first_stamp_s) return 0;
  const TimeNs shift_ns = nanoseconds(*options.first_stamp_s) - first_image_ns;
  if (first_imu_ns + shift_ns >= 0) return shift_ns;
  throw std::runtime_error(
      fmt::format("--first-stamp {:g} is too early: the IMU begins {:.3f} s before the first image",
                  *options.first_stamp_s, seconds_between(first_imu_ns, first_image_ns)));
}

// By how much stamps are moved, which the first image decides; the IMU of `dataset` is as it was
// recorded. Images are those that a live agent would fly.
TimeNs import_images(const Bag& bag, const BagTopic& topic, const Dataset& dataset,
                     const Options& options, const fs::path& cam0) {
  ImageList list(cam0);
  Progress progress(topic.messages);
  LeftOut left_out;
  StampOrder<CameraImage> order;
  std::optional<TimeNs> shift_ns;
  std::size_t read = 0;
  const auto write = [&](std::vector<CameraImage> images) {
    for (CameraImage& image : images) {
      if (const auto reason = wrong_size(image, dataset.camera, options)) {
        left_out.count(*reason);
        continue;
      }
      if (!shift_ns) shift_ns = shift_of(options, image.stamp_ns, dataset.imu.front().stamp_ns);
      write_png(list.add(image.stamp_ns + *shift_ns).string(), pixels_of(image));
    }
  };
  bag.read_images(topic, [&](Decoded<CameraImage> decoded) {
    stop_if_asked();
    progress.show(++read);
    if (const auto* rejected = std::get_if<Rejected>(&decoded)) {
      left_out.count(rejected->reason);
    } else {
      write(order.add(std::get<CameraImage>(std::move(decoded))));
    }
  });
  write(order.finish());
  left_out.count(order.counts());
  if (!shift_ns) left_out.fail(topic.name);
  list.close();
  left_out.warn(topic.name);
  return *shift_ns;
}

// Those that a live agent would use and, sorted, those that it would not, as they were late:
// drivers say some samples late, and a filter that reads a file need not mind.
std::vector<ImuSample> read_imu(const Bag& bag, const BagTopic& topic) {
  std::vector<ImuSample> samples;
  LeftOut left_out;
  StampOrder<ImuSample> order;
  const auto keep = [&](const std::vector<ImuSample>& believed) {
    samples.insert(samples.end(), believed.begin(), believed.end());
  };
  bag.read_imu(topic, [&](const Decoded<ImuSample>& decoded) {
    stop_if_asked();
    if (const auto* rejected = std::get_if<Rejected>(&decoded)) {
      left_out.count(rejected->reason);
      return;
    }
    const auto& sample = std::get<ImuSample>(decoded);
    keep(order.is_late(sample.stamp_ns) ? std::vector{sample} : order.add(sample));
  });
  keep(order.finish());
  left_out.count(order.counts());
  std::stable_sort(samples.begin(), samples.end(),
                   [](const ImuSample& a, const ImuSample& b) { return a.stamp_ns < b.stamp_ns; });
  const auto same_time = [&](const ImuSample& a, const ImuSample& b) {
    if (a.stamp_ns != b.stamp_ns) return false;
    left_out.count("a second one of the same time");
    return true;
  };
  samples.erase(std::unique(samples.begin(), samples.end(), same_time), samples.end());
  if (samples.empty()) left_out.fail(topic.name);
  left_out.warn(topic.name);
  return samples;
}

void copy_sensor_file(const Options& options, const fs::path& mav0, const char* sensor) {
  fs::create_directories(mav0 / sensor);
  for (const char* const name : {"sensor.yaml", "mask.png"}) {
    const fs::path file = fs::path(sensor) / name;
    if (fs::exists(options.sensors / file)) fs::copy_file(options.sensors / file, mav0 / file);
  }
}

// A warning names a file by the folder it was in; this one it is in now.
std::string with_name(std::string warning, const fs::path& was, const fs::path& is) {
  const std::size_t place = warning.find(was.string());
  return place == std::string::npos ? warning
                                    : warning.replace(place, was.string().size(), is.string());
}

void import_bag(const Options& options) {
  catch_stop_signals();
  Dataset dataset = read_sensors(options.sensors);
  const Bag bag(options.bag);
  const BagTopic images = choose_images(bag, options);
  const BagTopic imu =
      choose_topic(bag, options, options.imu_topic, "--imu-topic", {kImuType, kPx4ImuType});
  // No --force: recordings cannot be told from what was imported, and bags may be gone.
  StagedFolder folder(options.out, nullptr, "choose another --out");
  const fs::path mav0 = folder.path() / "mav0";
  copy_sensor_file(options, mav0, "cam0");
  copy_sensor_file(options, mav0, "imu0");
  dataset.imu = read_imu(bag, imu);
  const TimeNs shift_ns = import_images(bag, images, dataset, options, mav0 / "cam0");
  for (ImuSample& sample : dataset.imu) sample.stamp_ns += shift_ns;
  write_imu_csv(mav0 / "imu0" / "data.csv", dataset.imu);
  const Dataset written = read_dataset(mav0);  // as whoever flies it will
  const fs::path staged = folder.path();
  folder.commit();
  for (const std::string& warning : written.warnings)
    spdlog::warn("{}", with_name(warning, staged, options.out));
  std::printf("%s: %zu images in %.1f s, %zu IMU samples\n", options.out.c_str(),
              written.images.size(),
              seconds_between(written.images.front().stamp_ns, written.images.back().stamp_ns),
              written.imu.size());
}

}  // namespace

void add_import_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand("import", "A bag of ROS 1 or 2 as a folder to be flown");
  command->footer(
      "Example: covey import bags/uav0 --sensors calibration/uav0 --out data/yard/uav0\n"
      "         covey team data/yard --out runs/yard --unknown-start\n"
      "Images as covey agent hears them (grey, colours, Bayer's mosaics), or packed as JPEG or "
      "PNG.");
  command
      ->add_option("bag", options->bag,
                   "Folder of ros2 bag record, its .db3 or .mcap file, or a .bag of ROS 1")
      ->required()
      ->type_name("BAG");
  command
      ->add_option(
          "--sensors", options->sensors,
          "Folder with cam0/sensor.yaml and imu0/sensor.yaml, and cam0/mask.png if there is "
          "one, which are copied")
      ->required()
      ->type_name("DIR");
  command->add_option("--out", options->out, "The drone's folder to write; must not exist yet")
      ->required()
      ->type_name("DIR");
  command->add_option("--image-topic", options->image_topic,
                      "sensor_msgs/msg/Image or CompressedImage (default: the only one of the "
                      "former, else of the latter)");
  command->add_option("--imu-topic", options->imu_topic,
                      "sensor_msgs/msg/Imu or px4_msgs/msg/SensorCombined (default: the only one)");
  command
      ->add_option("--first-stamp", options->first_stamp_s,
                   "s; moves all stamps so that the first image has this one: puts flights of "
                   "different times side by side")
      ->check(NumberRange(1.0, 4e9));
  command->callback([options] { import_bag(*options); });
}

}  // namespace covey
