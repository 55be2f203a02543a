// SPDX-License-Identifier: Apache-2.0
// A data set as experiments use it (data_specs/sets/*.yaml): the published settings of all of its scenes, and
// what a scene has of its own. Reading is strict: file:line:column in every complaint.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/spec/yaml_reader.hpp"

namespace ubs::experiment {

struct SceneSpec {
  std::string name;                  // a word: letters, digits, _ and -
  std::string title;                 // as the paper's table prints it
  std::vector<std::string> folders;  // names that the scene's folder has in the wild, name itself included
  std::optional<int> width;          // of the published images [px], about
  std::vector<Assignment> settings;
};

struct DataSetSpec {
  std::filesystem::path file;
  std::string name, title;
  std::vector<std::string> folders;  // names that the folder of the whole set has in the wild
  std::vector<Assignment> settings;  // of every scene
  std::vector<SceneSpec> scenes;

  const SceneSpec* find(const std::string& scene) const;
};

DataSetSpec load_data_set_spec(const std::filesystem::path& path);

// Throws Error(data) naming `entry` when its text is no word that can be part of a file name.
std::string read_name(const YamlReader& reader, const YamlEntry& entry);
// Settings of a run, checked for keys and ranges.
std::vector<Assignment> read_settings(const YamlReader& reader, const YamlEntry& entry);

}  // namespace ubs::experiment
