// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

void add_tables_command(CLI::App& covey);

}  // namespace covey
