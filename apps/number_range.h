// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <string>

namespace covey {

// As CLI::Range, which lets "nan" pass: every comparison with it is false.
class NumberRange : public CLI::Validator {
 public:
  NumberRange(double least, double most)
      : Validator(
            [=](std::string& input) {
              double value = 0;
              const bool is_number = CLI::detail::lexical_cast(input, value);
              if (is_number && value >= least && value <= most) return std::string();
              return fmt::format("Value {} not in range {} to {}", input, least, most);
            },
            fmt::format("FLOAT in [{} - {}]", least, most)) {}
};

}  // namespace covey
