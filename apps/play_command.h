// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

void add_play_command(CLI::App& covey);

}  // namespace covey
