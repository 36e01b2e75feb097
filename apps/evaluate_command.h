// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey evaluate`: errors of an estimated trajectory against ground truth.
void add_evaluate_command(CLI::App& covey);

}  // namespace covey
