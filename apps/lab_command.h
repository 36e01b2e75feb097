// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey lab`: real agents over simulated radio links.
void add_lab_command(CLI::App& covey);

}  // namespace covey
