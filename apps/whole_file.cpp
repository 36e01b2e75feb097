// SPDX-License-Identifier: Apache-2.0
#include "apps/whole_file.h"

#include <fstream>
#include <stdexcept>
#include <system_error>

namespace covey {
namespace {

namespace fs = std::filesystem;

fs::path beside(const fs::path& file) {
  fs::path part = file;
  part += ".part";
  return part;
}

[[noreturn]] void fail(const fs::path& file) {
  throw std::runtime_error(file.string() +
                           ": cannot be written: does its folder exist, is the disk full?");
}

}  // namespace

void require_writable(const fs::path& file) {
  if (file.empty()) throw std::runtime_error("no file is named to write to");
  const fs::path folder = fs::absolute(file).parent_path();
  if (!fs::is_directory(folder)) {
    throw std::runtime_error(file.string() + ": cannot be written: " + folder.string() +
                             " is not a folder");
  }
  if (fs::is_directory(file)) throw std::runtime_error(file.string() + ": is a folder");
  if (!std::ofstream(beside(file))) fail(file);
  fs::remove(beside(file));
}

void make_writable_folder(const fs::path& folder) {
  if (folder.empty()) throw std::runtime_error("no folder is named to write to");
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw std::runtime_error(folder.string() + ": cannot be made: " + error.message());
  require_writable(folder / "any");
}

void write_whole_file(const fs::path& file, const std::string& content) {
  std::ofstream stream(beside(file), std::ios::binary);
  stream << content;
  stream.close();
  std::error_code error;
  if (stream) fs::rename(beside(file), file, error);
  if (stream && !error) return;
  std::error_code ignored;
  fs::remove(beside(file), ignored);
  fail(file);
}

}  // namespace covey
