// SPDX-License-Identifier: Apache-2.0
#include "frontend/vocabulary_thermal.h"

namespace covey {

const Vocabulary& thermal_vocabulary() {
  static const Vocabulary vocabulary = parse_vocabulary(
#include "frontend/vocabulary_thermal.inc"
  );
  return vocabulary;
}

}  // namespace covey
