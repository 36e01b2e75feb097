// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace covey {

// <name attributes>content</name> and a line's end. `name` may hold attributes; `content` is XML.
[[nodiscard]] inline std::string tag(const std::string& name, const std::string& content) {
  std::string out = "<";
  out += name;
  out += '>';
  out += content;
  out += "</";
  out += name.substr(0, name.find(' '));
  return out += ">\n";
}

}  // namespace covey
