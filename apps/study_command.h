// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey study`: what flying together is worth on simulated features.
void add_study_command(CLI::App& covey);

}  // namespace covey
