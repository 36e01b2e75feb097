// SPDX-License-Identifier: Apache-2.0
//
// The process of a link: all of DDS is in here, and nothing else. It owns the PeerLink and passes
// records (link_record.h) between it and the drone's process. What DDS does to it, by itself or
// because of hostile packets, ends here; the drone starts another (link_process.h).
#pragma once

namespace CLI {
class App;
}

namespace covey {

// The complaint of one that gives up because there is more to use than when it started.
inline constexpr char kAddressesCame[] = "addresses of this computer have come";

// Serves the drone at the other end of `socket` until that has said its last. False: gave up, and
// has complained.
bool run_link(int socket);

void add_link_command(CLI::App& covey);  // hidden: only a drone starts it

}  // namespace covey
