// SPDX-License-Identifier: Apache-2.0
//
// Somebody else's program with all three rooms: the link refuses a name before it opens a socket.
#include <iostream>
#include <stdexcept>

#include "comms/peer_link.h"
#include "estimator/estimator.h"
#include "frontend/collaborator.h"
#include "frontend/vocabulary_visual.h"

int main() {
  covey::LinkConfig link;
  link.agent = "no spaces, please";
  try {
    const covey::PeerLink refused(link);
  } catch (const std::runtime_error& error) {
    std::cout << error.what() << '\n';
    return 0;
  }
  return 1;
}
