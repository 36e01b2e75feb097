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

bool holds_only(const fs::path& folder, const std::set<std::string>& files) {
  std::set<std::string> found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (fs::is_regular_file(entry.symlink_status()))
      found.insert(entry.path().filename().string());
    else
      return false;
  return found == files;
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
