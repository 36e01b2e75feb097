// SPDX-License-Identifier: Apache-2.0
//
// The vocabulary that is compiled into the program for thermal cameras: 64 ORB words.
#pragma once

#include "frontend/place_recognition.h"

namespace covey {

[[nodiscard]] const Vocabulary& thermal_vocabulary();

}  // namespace covey
