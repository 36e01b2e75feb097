// SPDX-License-Identifier: Apache-2.0
//
// What lies in a folder, for who wants to know whether somebody's own files are among it. Links are
// somebody's own.
#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <set>
#include <string>

namespace covey {

[[nodiscard]] inline bool is_plain_file(const std::filesystem::path& path) {
  return std::filesystem::is_regular_file(std::filesystem::symlink_status(path));
}

[[nodiscard]] inline bool is_plain_folder(const std::filesystem::path& path) {
  return std::filesystem::is_directory(std::filesystem::symlink_status(path));
}

// Of nothing as well.
template <typename Test>
[[nodiscard]] bool all_entries(const std::filesystem::path& folder, Test is_good) {
  const std::filesystem::directory_iterator entries(folder);
  return std::all_of(begin(entries), end(entries),
                     [&](const auto& entry) { return is_good(entry.path()); });
}

// These files or some of them: nobody else's are among them, and no folder.
[[nodiscard]] inline bool holds_only(const std::filesystem::path& folder,
                                     const std::set<std::string>& files) {
  return is_plain_folder(folder) && all_entries(folder, [&](const std::filesystem::path& entry) {
           return is_plain_file(entry) && files.count(entry.filename()) > 0;
         });
}

// All of them, too.
[[nodiscard]] inline bool holds_exactly(const std::filesystem::path& folder,
                                        const std::set<std::string>& files) {
  using Entries = std::filesystem::directory_iterator;
  return holds_only(folder, files) &&
         std::distance(Entries(folder), Entries()) == static_cast<std::ptrdiff_t>(files.size());
}

}  // namespace covey
