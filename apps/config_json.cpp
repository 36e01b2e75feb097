// SPDX-License-Identifier: Apache-2.0
#include "apps/config_json.h"

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <stdexcept>

namespace covey {

std::string join(const std::vector<std::string>& words, const std::string& separator) {
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : separator) + word;
  return line;
}

std::string range_text(Range range) {
  std::ostringstream text;
  text << range.min << " .. " << range.max;
  return text.str();
}

namespace {

using Json = nlohmann::ordered_json;

// Sets what the file holds, and remembers which keys were asked for.
class ConfigReader : public ConfigVisitor {
 public:
  ConfigReader(const nlohmann::json& json, std::string file) : root_(json), file_(std::move(file)) {
    if (!root_.is_object()) throw std::runtime_error(file_ + ": not a JSON object");
  }

  void begin_section(const std::string& name) override {
    prefix_ = name + ".";
    sections_.push_back(name);
    keys_.clear();
    const auto found = root_.find(name);
    section_ = found == root_.end() ? nullptr : &*found;
    if (section_ != nullptr && !section_->is_object()) {
      throw std::runtime_error(file_ + ": '" + name + "' is not a section ({...})");
    }
  }

  void end_section() override {
    if (section_ != nullptr) refuse_unknown(*section_, prefix_, keys_);
  }

  void finish() const { refuse_unknown(root_, "", sections_); }

  void number(const char* key, double& value, Range range, const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    if (!json->is_number()) fail(key, "is not a number", *json);
    const double given = json->get<double>();
    if (!(given >= range.min && given <= range.max)) {
      fail(key, "is out of range (" + range_text(range) + ")", *json);
    }
    value = given;
  }

  void integer(const char* key, std::int64_t& value, Range range, const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    if (!json->is_number_integer()) fail(key, "is not a whole number", *json);
    const double given = json->get<double>();
    if (!(given >= range.min && given <= range.max)) {
      fail(key, "is out of range (" + range_text(range) + ")", *json);
    }
    value = json->get<std::int64_t>();
  }

  void flag(const char* key, bool& value, const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    if (!json->is_boolean()) fail(key, "is neither true nor false", *json);
    value = json->get<bool>();
  }

  void text(const char* key, std::string& value, const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    if (!json->is_string()) fail(key, "is not a text in quotes", *json);
    value = json->get<std::string>();
  }

  void texts(const char* key, std::vector<std::string>& value, const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    if (!json->is_array()) fail(key, "is not a list of texts", *json);
    value.clear();
    for (const nlohmann::json& item : *json) {
      if (!item.is_string()) fail(key, "is not a list of texts", *json);
      value.push_back(item.get<std::string>());
    }
  }

  void values(const char* key, std::map<std::string, std::string>& value, const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    if (!json->is_object()) fail(key, "is not a list of values ({...})", *json);
    value.clear();
    for (const auto& [name, item] : json->items()) {
      if (item.is_structured()) fail(key, "holds more than values", *json);
      value[name] = item.dump();
    }
  }

  void choice(const char* key, std::string& value, const std::vector<std::string>& names,
              const char*) override {
    const nlohmann::json* json = find(key);
    if (json == nullptr) return;
    for (const std::string& name : names) {
      if (*json == name) {
        value = name;
        return;
      }
    }
    fail(key, "is none of " + join(names, ", "), *json);
  }

 private:
  const nlohmann::json* find(const char* key) {
    keys_.emplace_back(key);
    if (section_ == nullptr) return nullptr;
    const auto found = section_->find(key);
    return found == section_->end() ? nullptr : &*found;
  }

  [[noreturn]] void fail(const char* key, const std::string& what,
                         const nlohmann::json& value) const {
    throw std::runtime_error(file_ + ": '" + prefix_ + key + "' " + what + ": " + value.dump());
  }

  void refuse_unknown(const nlohmann::json& object, const std::string& prefix,
                      const std::vector<std::string>& known) const {
    const std::set<std::string> names(known.begin(), known.end());
    for (const auto& [key, value] : object.items()) {
      if (names.count(key) == 0) {
        throw std::runtime_error(file_ + ": unknown key '" + std::string(prefix).append(key) +
                                 "' (known here: " + join(known, ", ") + ")");
      }
    }
  }

  const nlohmann::json& root_;
  const nlohmann::json* section_ = nullptr;
  std::string file_, prefix_;
  std::vector<std::string> sections_, keys_;
};

class ConfigPrinter : public ConfigVisitor {
 public:
  void begin_section(const std::string& name) override { section_ = &(json_[name] = Json({})); }
  void end_section() override {}
  void number(const char* key, double& value, Range, const char*) override {
    (*section_)[key] = value;
  }
  void integer(const char* key, std::int64_t& value, Range, const char*) override {
    (*section_)[key] = value;
  }
  void flag(const char* key, bool& value, const char*) override { (*section_)[key] = value; }
  void text(const char* key, std::string& value, const char*) override { (*section_)[key] = value; }
  void texts(const char* key, std::vector<std::string>& value, const char*) override {
    (*section_)[key] = value;
  }
  void values(const char* key, std::map<std::string, std::string>& value, const char*) override {
    Json& items = (*section_)[key] = Json::object();
    for (const auto& [name, item] : value) items[name] = Json::parse(item);
  }
  void choice(const char* key, std::string& value, const std::vector<std::string>&,
              const char*) override {
    (*section_)[key] = value;
  }

  [[nodiscard]] const Json& json() const { return json_; }

 private:
  Json json_ = Json::object();
  Json* section_ = nullptr;
};

}  // namespace

void set_from_json(const nlohmann::json& json, const std::string& where,
                   const ShowsKeys& settings) {
  ConfigReader reader(json, where);
  settings(reader);
  reader.finish();
}

nlohmann::ordered_json to_ordered_json(const ShowsKeys& settings) {
  ConfigPrinter printer;
  settings(printer);
  return printer.json();
}

}  // namespace covey
