// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>
#include <unistd.h>

namespace covey {

inline bool input_ended(int patience_ms) {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  char byte = 0;
  return poll(&input, 1, patience_ms) > 0 && read(STDIN_FILENO, &byte, 1) <= 0;
}

}  // namespace covey
