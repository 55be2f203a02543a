// SPDX-License-Identifier: Apache-2.0
// Strict reading of YAML files with structure: every complaint names file:line:column, and unknown or
// repeated keys are errors (Error(data)). Flat files of settings are read by load_yaml of settings.hpp.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "host/spec/settings.hpp"

namespace ubs {

// A setting as it stands in a file or on the command line: set_field takes it.
struct Assignment {
  std::string key, text, origin;
};
void set_fields(FieldValues fields, const std::vector<Assignment>& assignments);

struct YamlEntry {
  std::string key, where;  // where: "file:line:column" of the key
  YAML::Node value;
};

class YamlReader {
 public:
  explicit YamlReader(std::filesystem::path path);  // parses the file

  const YAML::Node& root() const { return root_; }
  const std::filesystem::path& path() const { return path_; }
  std::string where(const YAML::Node& node) const;  // "file:line:column"

  // All entries in the order of the file. `what` names the mapping in messages.
  std::vector<YamlEntry> entries(const YAML::Node& node, const std::string& what) const;
  // Entries by key, of which only `known` are allowed and `required` must be there.
  std::map<std::string, YamlEntry> mapping(const YAML::Node& node, const std::string& what,
                                           const std::vector<std::string>& known,
                                           const std::vector<std::string>& required = {}) const;
  // The scalar as it stands in the file; a sequence of scalars as "a,b,c".
  std::string text(const YamlEntry& entry) const;
  std::vector<std::string> list(const YamlEntry& entry) const;  // a sequence of scalars, not empty
  // Sets `fields` and returns what was set.
  std::vector<Assignment> assignments(FieldValues fields, const YAML::Node& node,
                                      const std::string& what) const;

 private:
  std::filesystem::path path_;
  YAML::Node root_;
};

}  // namespace ubs
