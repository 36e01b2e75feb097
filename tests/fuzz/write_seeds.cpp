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

void write_all(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  covey::PlaceAdvert advert = covey::samples::advert();
  write(folder / "request", encode(advert));
  advert.descriptor.resize(32);
  write(folder / "short_request", encode(advert));
  for (const std::size_t landmarks : {0u, 1u, 3u, 40u})
    write(folder / ("message_" + std::to_string(landmarks)),
          encode(covey::samples::keyframe("uav1", "uav0", landmarks)));
  write(folder / "full_message", encode(covey::samples::full_keyframe()));
  write(folder / "small_full_message",
        encode(covey::FullPeerKeyframe{covey::samples::keyframe("uav1", "uav0", 1),
                                       covey::samples::filter(1, 0)}));
  write(folder / "status",
        encode(covey::StatusSample{covey::samples::status(), {{1, 5, 6}, {2}}, 9}));
  write(folder / "odometry", encode(covey::OdometrySample{"uav0", covey::samples::odometry()}));
  using Kind = covey::RecordKind;
  write(folder / "report", records({{Kind::kReport, encode(report())}}));
  write(folder / "records",
        records({{Kind::kReport, encode(report())},
                 {Kind::kRequest, encode(advert)},
                 {Kind::kMessage, encode(covey::samples::keyframe("uav1", "uav0", 1))},
                 {Kind::kStatus, encode(covey::StatusSample{covey::samples::status(), {}})}}));
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
