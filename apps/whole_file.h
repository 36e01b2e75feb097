// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace covey {

// Written beside and renamed: whoever looks sees the old file or the new one, never half of it.
// Throws std::runtime_error naming the file.
void write_whole_file(const std::filesystem::path& file, const std::string& content);

}  // namespace covey
