// SPDX-License-Identifier: Apache-2.0
//
// Ctrl-C and SIGTERM end a run in good order: what was flown so far is written.
#pragma once

namespace covey {

void catch_stop_signals();  // SIGINT and SIGTERM, from now on
// Again they end the process, in a child that is about to become another program. Only system
// calls.
void release_stop_signals();
[[nodiscard]] bool stop_requested();

}  // namespace covey
