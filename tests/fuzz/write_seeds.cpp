// SPDX-License-Identifier: Apache-2.0
//
// Well-formed samples for the fuzzers to start from:  covey_fuzz_seeds FOLDER
#include <filesystem>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/link_record.h"
#include "comms/convert.h"
#include "comms/onboard_messages.h"
#include "tests/comms/samples.h"

namespace {

void write(const std::filesystem::path& file, const covey::Bytes& bytes) {
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

// One record with each sort of content.
covey::Bytes records(const std::vector<std::pair<covey::RecordKind, covey::Bytes>>& contents) {
  covey::RecordWriter writer;
  for (const auto& [kind, content] : contents)
    if (!writer.offer(kind, content)) throw std::runtime_error("a record is too long");
  return {writer.data(), writer.data() + writer.size()};
}

covey::LinkReport report() {
  covey::LinkReport out;
  out.statistics.rejected = {{"uav1", {{"sample too short", 8}}}};
  out.statistics.messages_sent_to = {{"uav1", 7}};
  out.statistics.restarts = {{"did not report", 1}};
  out.peers = {"uav1"};
  return out;
}

// The start of each of fuzz_files' readers' files, the reader's number before it.
void write_files(const std::filesystem::path& folder) {
  const std::string contents[] = {
      "# t x y z qx qy qz qw\n0.05 1 2 3 0 0 0 1\n0.10 1 2 3.1 0 0 0 1\n",
      "#stamp_ns\n50000000,1,0,0,0,0,0,1,0,0,0,0,1,0,0,0,1,0,0,1,0,1\n",
      "#timestamp [ns],w,a\n5000000,0.1,0,0,0,0,9.81\n10000000,0.1,0,0,0,0,9.81\n",
      "#timestamp,p,q,v,bw,ba\n5000000,1,2,3,1,0,0,0,0,0,0,0,0,0,0,0,0\n",
      "T_BS:\n  rows: 4\n  cols: 4\n  data: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n"
      "resolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [400, 400, 320, 240]\n"
      "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n",
      "gyroscope_noise_density: 1e-4\ngyroscope_random_walk: 1e-5\n"
      "accelerometer_noise_density: 1e-3\naccelerometer_random_walk: 1e-4\nrate_hz: 200\n",
      std::string(64, '3') + "\n",
      R"({"tracker": {"max_tracks": 200}, "link": {"profile": {"name": "clean"}}})",
      R"({"name": "a", "scenario": "castle_around", "loss": [0, 0.1], "seeds": [1]})",
      "stamp_ns,read_ms\n5,0.1\n",
      "clock_ms,event,peer,keyframe_id\n0.5,asked,uav1,3\n",
      "0.1,0.2\n0.3,0.4\n",
      "\x89PNG\r\n\x1a\n",
      std::string("\x89MCAP0\r\n\x0f\x04\0\0\0\0\0\0\0\0\0\0\0", 21),
      std::string("#ROSBAG V2.0\n\x09\0\0\0\x05\0\0\0op=\x03x\0\0\0\0", 30),
      "\xff\xd8\xff\xe0",
  };
  char reader = 0;
  for (const std::string& content : contents) {
    const std::string bytes = reader + content;
    write(folder / ("file_" + std::to_string(reader)), {bytes.begin(), bytes.end()});
    ++reader;
  }
}

void write_all(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  covey::PlaceAdvert advert = covey::samples::advert();
  write(folder / "request", encode(advert));
  advert.descriptor.resize(32);
  write(folder / "short_request", encode(advert));
  for (const std::size_t landmarks : {0u, 1u, 3u, 40u})
    write(folder / ("message_" + std::to_string(landmarks)),
          encode(covey::samples::keyframe("uav1", "uav0", landmarks)));
  write(folder / "found", encode(covey::samples::found()));
  write(folder / "full_message", encode(covey::samples::full_keyframe()));
  write(folder / "small_full_message",
        encode(covey::FullPeerKeyframe{covey::samples::keyframe("uav1", "uav0", 1),
                                       covey::samples::filter(1, 0)}));
  write(folder / "status",
        encode(covey::StatusSample{covey::samples::status(), {{1, 5, 6}, {2}}, 9}));
  write(folder / "odometry", encode(covey::OdometrySample{"uav0", covey::samples::odometry()}));
  write(folder / "image", encode(covey::CameraImage{7, 4, 2, 1, std::vector<std::uint8_t>(8)}));
  write(folder / "imu", encode(covey::ImuSample{7, {0.1, 0.2, 0.3}, {0, 0, 9.81}}));
  write(folder / "px4_imu", covey::encode_px4_imu({7000, {0.1, 0.2, 0.3}, {0, 0, 9.81}}));
  using Kind = covey::RecordKind;
  write(folder / "report", records({{Kind::kReport, encode(report())}}));
  write(folder / "records",
        records({{Kind::kReport, encode(report())},
                 {Kind::kRequest, encode(advert)},
                 {Kind::kMessage, encode(covey::samples::keyframe("uav1", "uav0", 1))},
                 {Kind::kStatus, encode(covey::StatusSample{covey::samples::status(), {}})}}));
  write_files(folder);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: covey_fuzz_seeds FOLDER\n";
    return 2;
  }
  try {
    write_all(argv[1]);
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
  return 0;
}
