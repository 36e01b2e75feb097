// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace covey {

// Unoptimised and sanitized builds fly a few seeds and look for crashes and divergence only.
#ifdef NDEBUG
inline constexpr bool kEnoughForStatistics = true;
#else
inline constexpr bool kEnoughForStatistics = false;
#endif

}  // namespace covey
