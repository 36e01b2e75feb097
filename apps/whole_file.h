// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace covey {

// Written beside and renamed: whoever looks sees the old file or the new one, never half of it.
// Throws std::runtime_error naming the file.
void write_whole_file(const std::filesystem::path& file, const std::string& content);

// Before minutes of work, not after them: throw std::runtime_error where a file could not be
// written, or no files into a folder, which is made.
void require_writable(const std::filesystem::path& file);
void make_writable_folder(const std::filesystem::path& folder);

}  // namespace covey
