// SPDX-License-Identifier: Apache-2.0
#include "apps/whole_file.h"

#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <fstream>
#include <stdexcept>
#include <system_error>
#include <vector>

namespace covey {
namespace {

namespace fs = std::filesystem;

// By its number nobody's own.
fs::path beside(const fs::path& file) {
  fs::path part = file;
  part += ".part-" + std::to_string(::getpid());
  return part;
}

// Where its links lead. Throws unless a file is there, or may be made there.
fs::path target_of(const fs::path& file) {
  std::error_code ignored;
  const fs::path target = fs::is_symlink(file, ignored) ? fs::weakly_canonical(file) : file;
  const fs::file_status status = fs::symlink_status(target, ignored);
  if (fs::is_symlink(status)) throw std::runtime_error(file.string() + ": is a link to nothing");
  if (fs::is_directory(status)) throw std::runtime_error(file.string() + ": is a folder");
  if (fs::exists(status) && !fs::is_regular_file(status))
    throw std::runtime_error(file.string() + ": is no file that can be replaced");
  return target;
}

std::string error_text() { return std::generic_category().message(errno); }

[[noreturn]] void fail(const fs::path& file) {
  throw std::runtime_error(file.string() +
                           ": cannot be written: does its folder exist, is the disk full?");
}

}  // namespace

std::string read_whole_file(const fs::path& file) {
  std::error_code ignored;
  if (fs::is_directory(file, ignored))
    throw std::runtime_error(file.string() + ": cannot be read: it is a folder");
  std::ifstream stream(file, std::ios::binary);
  if (!stream) {
    throw std::runtime_error(file.string() + ": cannot be read: " +
                             (errno == ENOENT ? "is the path right?" : error_text()));
  }
  std::string content;
  std::vector<char> block(std::size_t{1} << 16);
  while (stream) {  // its end fails it as well, but only an error makes it bad
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    content.append(block.data(), static_cast<std::size_t>(stream.gcount()));
  }
  if (stream.bad()) throw std::runtime_error(file.string() + ": cannot be read: " + error_text());
  return content;
}

void require_writable(const fs::path& file) {
  if (file.empty()) throw std::runtime_error("no file is named to write to");
  const fs::path folder = fs::absolute(file).parent_path();
  if (!fs::is_directory(folder)) {
    throw std::runtime_error(file.string() + ": cannot be written: " + folder.string() +
                             " is not a folder");
  }
  const fs::path part = beside(target_of(file));
  if (!std::ofstream(part))
    throw std::runtime_error(file.string() + ": cannot be written: " + error_text());
  fs::remove(part);
}

void write_whole_file(const fs::path& file, const std::string& content) {
  const fs::path target = target_of(file), part = beside(target);
  std::ofstream stream(part, std::ios::binary);
  stream << content;
  stream.close();
  std::error_code error;
  if (stream) fs::rename(part, target, error);
  if (stream && !error) return;
  std::error_code ignored;
  fs::remove(part, ignored);
  fail(file);
}

}  // namespace covey
