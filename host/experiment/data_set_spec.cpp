// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/data_set_spec.hpp"

#include <algorithm>
#include <charconv>

#include "host/base/error.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs::experiment {
namespace {

// Where a data set comes from is for people who read the file; all but notes must be stated.
void check_provenance(const YamlReader& reader, const YamlEntry& entry) {
  const std::vector<std::string> needed{"source", "licence", "layout", "split", "resolution", "background"};
  std::vector<std::string> known = needed;
  known.emplace_back("notes");
  for (const auto& [key, text] : reader.mapping(entry.value, "dataset", known, needed)) reader.text(text);
}

int read_width(const YamlReader& reader, const YamlEntry& entry) {
  const std::string text = reader.text(entry);
  int width = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), width);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size() || width < 1 || width > 100'000)
    fail(ErrorKind::data, "{}: {} = '{}' is not allowed: expected a width in pixels", entry.where, entry.key,
         text);
  return width;
}

SceneSpec read_scene(const YamlReader& reader, const YamlEntry& entry, std::optional<int> width) {
  SceneSpec scene;
  scene.name = read_name(reader, {entry.key, entry.where, YAML::Node(entry.key)});
  scene.title = scene.name;
  scene.folders = {scene.name};
  scene.width = width;
  if (entry.value.IsNull()) return scene;
  const auto keys = reader.mapping(entry.value, fmt::format("scene '{}'", scene.name),
                                   {"title", "folders", "width", "settings"});
  if (const auto at = keys.find("title"); at != keys.end()) scene.title = reader.text(at->second);
  if (const auto at = keys.find("width"); at != keys.end()) scene.width = read_width(reader, at->second);
  if (const auto at = keys.find("settings"); at != keys.end())
    scene.settings = read_settings(reader, at->second);
  if (const auto at = keys.find("folders"); at != keys.end())
    for (std::string& folder : reader.list(at->second))
      if (folder != scene.name) scene.folders.push_back(std::move(folder));
  return scene;
}

}  // namespace

const SceneSpec* DataSetSpec::find(const std::string& scene) const {
  const auto found = std::ranges::find(scenes, scene, &SceneSpec::name);
  return found == scenes.end() ? nullptr : &*found;
}

std::string read_name(const YamlReader& reader, const YamlEntry& entry) {
  const std::string name = reader.text(entry);
  const auto usual = [](unsigned char c) { return std::isalnum(c) || c == '_' || c == '-'; };
  if (name.empty() || name.size() > 64 || !std::ranges::all_of(name, usual))
    fail(ErrorKind::data, "{}: the name '{}' must be of letters, digits, _ and - (it names folders)",
         entry.where, name);
  return name;
}

std::vector<Assignment> read_settings(const YamlReader& reader, const YamlEntry& entry) {
  TrainSettings scratch;
  return reader.assignments(bind_fields(scratch, train_fields()), entry.value, entry.key);
}

DataSetSpec load_data_set_spec(const std::filesystem::path& path) {
  const YamlReader reader(path);
  const auto keys = reader.mapping(reader.root(), "a data set",
                                   {"name", "title", "dataset", "folders", "width", "settings", "scenes"},
                                   {"name", "dataset", "scenes"});
  DataSetSpec set;
  set.file = path;
  set.name = set.title = read_name(reader, keys.at("name"));
  check_provenance(reader, keys.at("dataset"));
  set.folders = {set.name};
  std::optional<int> width;
  if (const auto at = keys.find("title"); at != keys.end()) set.title = reader.text(at->second);
  if (const auto at = keys.find("width"); at != keys.end()) width = read_width(reader, at->second);
  if (const auto at = keys.find("settings"); at != keys.end())
    set.settings = read_settings(reader, at->second);
  if (const auto at = keys.find("folders"); at != keys.end())
    for (std::string& folder : reader.list(at->second))
      if (folder != set.name) set.folders.push_back(std::move(folder));
  for (const YamlEntry& entry : reader.entries(keys.at("scenes").value, "scenes"))
    set.scenes.push_back(read_scene(reader, entry, width));
  if (set.scenes.empty()) fail(ErrorKind::data, "{}: there are no scenes", keys.at("scenes").where);
  return set;
}

}  // namespace ubs::experiment
