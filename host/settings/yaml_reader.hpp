// SPDX-License-Identifier: Apache-2.0
// YamlReader reads a flat YAML file of settings. Every error is an Error(data) whose message contains the
// file and, if it concerns a part of the file, line and column. Unknown or repeated keys are errors.
// load_yaml() of settings.hpp reads a file with a single call.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "host/settings/fields.hpp"

namespace ubs {

struct YamlEntry {
  std::string key, where;  // where: "file:line:column" of the key
  YAML::Node value;
};

class YamlReader {
 public:
  explicit YamlReader(std::filesystem::path path);  // parses the file

  const YAML::Node& root() const { return root_; }

  // Returns all entries in the order of the file. `what` is the name of the mapping in messages.
  std::vector<YamlEntry> entries(const YAML::Node& node, const std::string& what) const;
  // Returns the value of an entry: a scalar as it is written in the file, or a sequence of scalars as
  // "a,b,c".
  std::string text(const YamlEntry& entry) const;
  // Sets `fields` to the values of the file, and returns the keys. An empty file sets nothing.
  std::vector<std::string> set(FieldValues fields) const;

 private:
  std::string where(const YAML::Node& node) const;  // "file:line:column"

  std::filesystem::path path_;
  YAML::Node root_;
};

}  // namespace ubs
