// SPDX-License-Identifier: Apache-2.0
//
// Every key of the configuration is declared once (config_schema.cpp); whoever visits the
// declarations reads a file into them, prints their values or prints what they mean.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace covey {

struct Range {
  double min = 0, max = 0;  // both included
};

class ConfigVisitor {
 public:
  ConfigVisitor() = default;
  ConfigVisitor(const ConfigVisitor&) = delete;
  ConfigVisitor& operator=(const ConfigVisitor&) = delete;
  virtual ~ConfigVisitor() = default;

  virtual void begin_section(const std::string& name) = 0;
  virtual void end_section() = 0;

  // `meaning` starts with the unit in brackets where there is one.
  virtual void number(const char* key, double& value, Range range, const char* meaning) = 0;
  virtual void integer(const char* key, std::int64_t& value, Range range, const char* meaning) = 0;
  virtual void flag(const char* key, bool& value, const char* meaning) = 0;
  virtual void text(const char* key, std::string& value, const char* meaning) = 0;
  virtual void texts(const char* key, std::vector<std::string>& value, const char* meaning) = 0;
  // Keys and values of somebody else's, who also checks them. The values are JSON.
  virtual void values(const char* key, std::map<std::string, std::string>& value,
                      const char* meaning) = 0;
  virtual void choice(const char* key, std::string& value, const std::vector<std::string>& names,
                      const char* meaning) = 0;

  // Degrees in the file, radians in the program: the key ends in _deg.
  void angle(const char* key_deg, double& radians, Range degrees, const char* meaning);

  template <typename Integer>
  void count(const char* key, Integer& value, Range range, const char* meaning) {
    auto wide = static_cast<std::int64_t>(value);
    integer(key, wide, range, meaning);
    value = static_cast<Integer>(wide);
  }

  // `names` in the order of the enumeration, which counts from zero.
  template <typename Enum>
  void option(const char* key, Enum& value, const std::vector<std::string>& names,
              const char* meaning) {
    std::string name = names.at(static_cast<std::size_t>(value));
    choice(key, name, names, meaning);
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (names[i] == name) value = static_cast<Enum>(i);
    }
  }
};

}  // namespace covey
