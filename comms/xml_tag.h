// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace covey {

// What XML, or HTML, would read as its own marks is written out: text for a content or an
// attribute.
[[nodiscard]] inline std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

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
