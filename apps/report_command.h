// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey report`: rebuilds report.html of a run.
void add_report_command(CLI::App& covey);

}  // namespace covey
