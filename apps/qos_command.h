// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey qos`: profiles of the link, with their reasons or as Fast DDS XML.
void add_qos_command(CLI::App& covey);

}  // namespace covey
