// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey inspect`: pictures and figures of what one drone's camera saw.
void add_inspect_command(CLI::App& covey);

}  // namespace covey
