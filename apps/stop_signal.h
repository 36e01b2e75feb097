// SPDX-License-Identifier: Apache-2.0
//
// Ctrl-C and SIGTERM end a run in good order: what was flown so far is written.
#pragma once

namespace covey {

void catch_stop_signals();  // SIGINT and SIGTERM, from now on
[[nodiscard]] bool stop_requested();

}  // namespace covey
