// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace CLI {
class App;
}

namespace covey {

// `covey train-vocabulary`: the words of a vocabulary from images.
void add_train_vocabulary_command(CLI::App& covey);

}  // namespace covey
