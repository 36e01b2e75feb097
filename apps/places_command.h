// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey places`: precision and recall of place recognition on datasets with ground truth.
void add_places_command(CLI::App& covey);

}  // namespace covey
