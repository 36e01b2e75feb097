// SPDX-License-Identifier: Apache-2.0
//
// The readers of files that come from elsewhere, under libFuzzer: the first byte says which, the
// rest is the file. A reader returns, or throws the std::runtime_error that a person is shown.
#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "apps/bag_file.h"
#include "apps/config_file.h"
#include "apps/dataset.h"
#include "apps/lab_experiment.h"
#include "apps/packed_image.h"
#include "apps/png_file.h"
#include "apps/run_files.h"
#include "apps/sensor_file.h"
#include "apps/trajectory_file.h"
#include "apps/vocabulary_file.h"

namespace {

template <auto reader>
void read(const std::string& file) {
  (void)reader(file);
}

void unpack(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  (void)covey::unpacked(
      {1, "bayer_rggb8; png compressed ", {std::istreambuf_iterator<char>(in), {}}});
}

constexpr void (*kReaders[])(const std::string&) = {
    read<covey::read_trajectory>,  read<covey::read_covariances>,
    read<covey::read_imu>,         read<covey::read_ground_truth>,
    read<covey::read_camera_file>, read<covey::read_imu_file>,
    read<covey::load_vocabulary>,  read<covey::read_config>,
    read<covey::read_experiment>,  read<covey::read_timings>,
    read<covey::read_exchange>,    read<covey::read_field>,
    read<covey::read_png>,         read<covey::open_mcap_bag>,
    read<covey::open_ros1_bag>,    unpack,
};

// A file that is nowhere on disk.
class MemoryFile {
 public:
  MemoryFile() : descriptor_(memfd_create("fuzzed", MFD_CLOEXEC)) {
    if (descriptor_ < 0) std::abort();
  }
  void hold(const std::uint8_t* data, std::size_t size) const {
    if (ftruncate(descriptor_, 0) != 0) std::abort();
    if (pwrite(descriptor_, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  }
  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const MemoryFile file;
  if (size == 0) return 0;
  file.hold(data + 1, size - 1);
  try {
    kReaders[data[0] % std::size(kReaders)](file.path());
  } catch (const std::runtime_error&) {
  }
  return 0;
}
