// SPDX-License-Identifier: Apache-2.0
#include "apps/whole_file.h"

#include <fstream>
#include <stdexcept>
#include <system_error>

namespace covey {

void write_whole_file(const std::filesystem::path& file, const std::string& content) {
  std::filesystem::path beside = file;
  beside += ".part";
  std::ofstream stream(beside, std::ios::binary);
  stream << content;
  stream.close();
  std::error_code error;
  if (stream) std::filesystem::rename(beside, file, error);
  if (stream && !error) return;
  std::error_code ignored;
  std::filesystem::remove(beside, ignored);
  throw std::runtime_error(file.string() +
                           ": cannot be written: does its folder exist, is the disk full?");
}

}  // namespace covey
