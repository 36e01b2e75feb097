// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey agent`: one drone, one process.
void add_agent_command(CLI::App& covey);

}  // namespace covey
