// SPDX-License-Identifier: Apache-2.0
//
// Covey's commands as a person would type them, in this process.
#pragma once

#include <string>

namespace covey {

// `arguments`: what follows `covey`. Throws what the command throws.
void run_command(const std::string& arguments);

// What the command complains about, or nothing.
[[nodiscard]] std::string complaint_of(const std::string& arguments);

}  // namespace covey
