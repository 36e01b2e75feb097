// SPDX-License-Identifier: Apache-2.0
#include "frontend/vocabulary_visual.h"

namespace covey {

const Vocabulary& visual_vocabulary() {
  static const Vocabulary vocabulary = parse_vocabulary(
#include "frontend/vocabulary_visual.inc"
  );
  return vocabulary;
}

}  // namespace covey
