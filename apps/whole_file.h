// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <set>
#include <string>

namespace covey {

// Throws std::runtime_error naming the file and why it cannot be read.
[[nodiscard]] std::string read_whole_file(const std::filesystem::path& file);

// Written beside and renamed: whoever looks sees the old file or the new one, never half of it.
// Links stay and what they lead to is replaced. Throws std::runtime_error naming the file; of what
// is no file, a device say, as well.
void write_whole_file(const std::filesystem::path& file, const std::string& content);

// Before minutes of work, not after them: throws std::runtime_error where a file could not be
// written.
void require_writable(const std::filesystem::path& file);

// Whether a folder holds these files, all of them and nothing else: somebody's own are not lost
// with it.
[[nodiscard]] bool holds_only(const std::filesystem::path& folder,
                              const std::set<std::string>& files);

}  // namespace covey
