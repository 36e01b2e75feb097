// SPDX-License-Identifier: Apache-2.0
//
// Complaints of a link that cannot be made as it is wanted.
#pragma once

#include <stdexcept>
#include <string>

namespace covey {

// `complaint` says what is wrong and what to do.
inline void require(bool good, const std::string& complaint) {
  if (!good) throw std::runtime_error("link: " + complaint);
}

}  // namespace covey
