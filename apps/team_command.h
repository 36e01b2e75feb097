// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey team`: flies all drones of a dataset, each in a process of its own.
void add_team_command(CLI::App& covey);

}  // namespace covey
