// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey keys`: makes, extends and revokes the keys of a team, by which its links are secured.
void add_keys_command(CLI::App& covey);

}  // namespace covey
