// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

namespace covey {

// Makes room in a drone's folder for a new flight. One that has left a pose there, finished or cut
// off by a restart in the air, is not lost: its files move to `folder`/earlier/N, which is
// returned. What another has left is removed.
std::optional<std::filesystem::path> set_aside_earlier_flight(const std::filesystem::path& folder);

}  // namespace covey
