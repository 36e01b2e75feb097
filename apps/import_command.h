// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// covey import: a bag of ROS 2 as one drone's EuRoC folder.
void add_import_command(CLI::App& covey);

}  // namespace covey
