// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
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

}  // namespace covey
