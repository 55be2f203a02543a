// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/experiment_spec.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs::experiment {
namespace {

const Metric kMetrics[] = {
    {"psnr", "PSNR [dB]",
     "mean over the test views of the mean over the three channels of 10 log10(1 / mse), as the published "
     "code "
     "computes it",
     2, true},
    {"ssim", "SSIM", "zero-padded, 11 x 11 Gaussian of sigma 1.5, mean over the test views", 3, true},
    {"lpips", "LPIPS", "VGG16, images fed in [0, 1] as the published code does (lpips_vgg_unit)", 3, true},
    {"minutes", "training [min]", "wall time of training without loading and evaluation", 1, false},
    {"fps", "FPS", "images per second of wall time, conditioning on the view included", 1, false},
    {"splats", "splats", "at the end of training", 0, false},
    {"mib", "MiB", "size of model.ply / 2^20", 1, false},
};

struct Published {
  std::string source;
  std::vector<std::string> columns;
};

Published read_published(const YamlReader& reader, const YamlEntry& entry) {
  const auto keys = reader.mapping(entry.value, "published", {"source", "columns"}, {"source", "columns"});
  Published published{reader.text(keys.at("source")), reader.list(keys.at("columns"))};
  std::vector<std::string> known;
  for (const Metric& metric : kMetrics) known.emplace_back(metric.key);
  for (std::size_t i = 0; i < published.columns.size(); ++i) {
    const std::string& column = published.columns[i];
    const std::string& where = keys.at("columns").where;
    if (std::ranges::find(known, column) == known.end())
      fail(ErrorKind::data, "{}: unknown column '{}'; there are: {}", where, column, fmt::join(known, ", "));
    if (std::ranges::count(published.columns, column) > 1)
      fail(ErrorKind::data, "{}: column '{}' appears twice", where, column);
  }
  return published;
}

std::map<std::string, double> read_values(const YamlReader& reader, const YamlEntry& entry,
                                          const std::vector<std::string>& columns) {
  if (!entry.value.IsSequence() || entry.value.size() != columns.size())
    fail(ErrorKind::data, "{}: '{}' needs one value, or null, for each of the columns {}", entry.where,
         entry.key, fmt::join(columns, ", "));
  std::map<std::string, double> values;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const YAML::Node item = entry.value[i];
    if (item.IsNull()) continue;
    const std::string text = item.IsScalar() ? item.Scalar() : "";
    double value = 0;
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    if (result.ec != std::errc() || result.ptr != text.data() + text.size() || !std::isfinite(value))
      fail(ErrorKind::data, "{}: {} of '{}' must be a number or null, not '{}'", reader.where(item),
           columns[i], entry.key, text);
    values[columns[i]] = value;
  }
  return values;
}

const DataEntry* find_set(const std::vector<DataEntry>& data, const std::string& name) {
  const auto found = std::ranges::find_if(data, [&](const DataEntry& d) { return d.set.name == name; });
  return found == data.end() ? nullptr : &*found;
}

void read_row_published(const YamlReader& reader, const YamlEntry& entry, const std::vector<DataEntry>& data,
                        const std::optional<Published>& published, RowSpec& row) {
  if (!published)
    fail(ErrorKind::data, "{}: published values need 'published: {{source, columns}}' in the file",
         entry.where);
  for (const YamlEntry& set : reader.entries(entry.value, "published values")) {
    const DataEntry* known = find_set(data, set.key);
    if (!known) fail(ErrorKind::data, "{}: '{}' is no data set of this experiment", set.where, set.key);
    for (const YamlEntry& scene : reader.entries(set.value, set.key)) {
      if (scene.key != kAverage && std::ranges::find(known->scenes, scene.key) == known->scenes.end())
        fail(ErrorKind::data, "{}: '{}' is no scene of '{}' in this experiment", scene.where, scene.key,
             set.key);
      row.published[set.key + "/" + scene.key] = read_values(reader, scene, published->columns);
    }
  }
}

DataEntry read_data(const YamlReader& reader, const YAML::Node& node) {
  const auto keys = reader.mapping(node, "an entry of data", {"set", "scenes", "settings"}, {"set"});
  DataEntry entry;
  entry.set = load_data_set_spec(reader.path().parent_path() / reader.text(keys.at("set")));
  if (const auto at = keys.find("settings"); at != keys.end())
    entry.settings = read_settings(reader, at->second);
  const auto wanted = keys.find("scenes");
  if (wanted == keys.end()) {
    for (const SceneSpec& scene : entry.set.scenes) entry.scenes.push_back(scene.name);
    return entry;
  }
  const std::vector<std::string> names = reader.list(wanted->second);
  for (const std::string& name : names)
    if (!entry.set.find(name))
      fail(ErrorKind::data, "{}: data set '{}' has no scene '{}'", wanted->second.where, entry.set.name,
           name);
  for (const SceneSpec& scene : entry.set.scenes)
    if (std::ranges::find(names, scene.name) != names.end()) entry.scenes.push_back(scene.name);
  return entry;
}

RowSpec read_row(const YamlReader& reader, const YAML::Node& node, const ExperimentSpec& spec,
                 const std::optional<Published>& published) {
  const auto keys = reader.mapping(node, "a row", {"name", "label", "settings", "published"}, {"name"});
  RowSpec row;
  row.name = row.label = read_name(reader, keys.at("name"));
  if (std::ranges::find(spec.rows, row.name, &RowSpec::name) != spec.rows.end())
    fail(ErrorKind::data, "{}: there are two rows '{}'", keys.at("name").where, row.name);
  if (const auto at = keys.find("label"); at != keys.end()) row.label = reader.text(at->second);
  if (const auto at = keys.find("settings"); at != keys.end())
    row.settings = read_settings(reader, at->second);
  if (const auto at = keys.find("published"); at != keys.end())
    read_row_published(reader, at->second, spec.data, published, row);
  return row;
}

void require_sequence(const YamlEntry& entry) {
  if (!entry.value.IsSequence() || entry.value.size() == 0)
    fail(ErrorKind::data, "{}: {} must be a list with at least one entry", entry.where, entry.key);
}

}  // namespace

std::span<const Metric> metrics() { return kMetrics; }

ExperimentSpec load_experiment_spec(const std::filesystem::path& path) {
  const YamlReader reader(path);
  const auto keys = reader.mapping(reader.root(), "an experiment",
                                   {"name", "title", "notes", "published", "settings", "data", "rows"},
                                   {"name", "data", "rows"});
  ExperimentSpec spec;
  spec.file = path;
  spec.name = spec.title = read_name(reader, keys.at("name"));
  if (const auto at = keys.find("title"); at != keys.end()) spec.title = reader.text(at->second);
  if (const auto at = keys.find("notes"); at != keys.end()) spec.notes = reader.text(at->second);
  if (const auto at = keys.find("settings"); at != keys.end())
    spec.settings = read_settings(reader, at->second);
  std::optional<Published> published;
  if (const auto at = keys.find("published"); at != keys.end()) {
    published = read_published(reader, at->second);
    spec.source = published->source;
  }
  require_sequence(keys.at("data"));
  for (const YAML::Node& node : keys.at("data").value) {
    DataEntry entry = read_data(reader, node);
    if (find_set(spec.data, entry.set.name))
      fail(ErrorKind::data, "{}: there are two entries for data set '{}'", reader.where(node),
           entry.set.name);
    spec.data.push_back(std::move(entry));
  }
  require_sequence(keys.at("rows"));
  for (const YAML::Node& node : keys.at("rows").value)
    spec.rows.push_back(read_row(reader, node, spec, published));
  return spec;
}

}  // namespace ubs::experiment
