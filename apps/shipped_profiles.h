// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace covey {

extern const char* const kShippedProfiles;  // comms/link_profiles.json as it was built in

}  // namespace covey
