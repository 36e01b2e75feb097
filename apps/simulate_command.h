// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey simulate`: renders a scenario into EuRoC folders.
void add_simulate_command(CLI::App& covey);

}  // namespace covey
