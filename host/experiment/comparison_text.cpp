// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "host/base/text.hpp"
#include "host/experiment/comparison.hpp"

namespace ubs::experiment {
namespace {

constexpr const char* kUnknown = "–";

std::string number(const std::optional<double>& value, int decimals, bool sign = false) {
  if (!value) return kUnknown;
  return sign ? fmt::format("{:+.{}f}", *value, decimals) : fmt::format("{:.{}f}", *value, decimals);
}

std::string exact(const std::optional<double>& value) { return value ? fmt::format("{:.10g}", *value) : ""; }

// Metrics that we measured, or the paper has, somewhere.
std::vector<Metric> columns_of(const std::vector<Line>& lines) {
  std::vector<Metric> columns;
  for (const Metric& metric : metrics())
    if (std::ranges::any_of(lines, [&](const Line& line) { return line.cells.contains(metric.key); }))
      columns.push_back(metric);
  return columns;
}

// Values of finished runs that stand empty in the table, by metric and reason.
std::string reasons_of_gaps(const std::vector<Line>& lines, const std::vector<Metric>& columns) {
  std::string text;
  for (const Metric& metric : columns) {
    std::map<std::string, std::vector<std::string>> runs;  // by reason
    for (const Line& line : lines)
      if (const auto at = line.lacks.find(metric.key); at != line.lacks.end())
        runs[at->second].push_back(line.row + "/" + line.scene);
    for (const auto& [reason, names] : runs)
      text += fmt::format("- {} not measured of {}: {}\n", metric.name, fmt::join(names, ", "),
                          table_cell(reason));
  }
  return text.empty() ? "" : "\n" + text;
}

std::string table_head(const std::vector<Metric>& columns) {
  std::string names = "| method | scene |", rule = "|---|---|";
  for (const Metric& metric : columns) {
    names += fmt::format(" {} | paper |", metric.name);
    rule += "---|---|";
    if (metric.quality) names += " difference |", rule += "---|";
  }
  return names + "\n" + rule + "\n";
}

std::string table_line(const Line& line, const std::vector<Metric>& columns) {
  const bool mean = line.scene == kAverage;
  std::string title = table_cell(line.title);
  if (mean) title += fmt::format(" of {} of {}", line.scenes_present, line.scenes_planned);
  if (line.state != JobState::done) title += fmt::format(" ({})", to_string(line.state));
  std::string text = fmt::format("| {} | {} |", table_cell(line.label), title);
  for (const Metric& metric : columns) {
    const auto at = line.cells.find(metric.key);
    const Cell cell = at == line.cells.end() ? Cell{} : at->second;
    text += fmt::format(" {} | {} |", number(cell.ours, metric.decimals),
                        number(cell.published, metric.decimals));
    if (metric.quality) text += fmt::format(" {} |", number(cell.difference(), metric.decimals, true));
  }
  return text + "\n";
}

std::string average_line(const Line& mean, const Comparison& comparison, const std::vector<Metric>& columns) {
  const auto at = comparison.published_averages.find(mean.row + "/" + mean.set);
  if (at == comparison.published_averages.end()) return "";
  std::string text =
      fmt::format("| {} | average as printed, {} scenes |", table_cell(mean.label), mean.scenes_planned);
  for (const Metric& metric : columns) {
    const auto value = at->second.find(metric.key);
    text += fmt::format(
        " {} | {} |{}", kUnknown,
        number(value == at->second.end() ? std::nullopt : std::optional(value->second), metric.decimals),
        metric.quality ? fmt::format(" {} |", kUnknown) : "");
  }
  return text + "\n";
}

std::string set_table(const DataSetSpec& set, const Comparison& comparison) {
  std::vector<Line> lines;
  for (const Line& line : comparison.lines)
    if (line.set == set.name) lines.push_back(line);
  if (lines.empty()) return "";
  const std::vector<Metric> columns = columns_of(lines);
  std::string text = fmt::format("\n## {}\n\n{}", table_cell(set.title), table_head(columns));
  for (const Line& line : lines) {
    text += table_line(line, columns);
    if (line.scene == kAverage) text += average_line(line, comparison, columns);
  }
  return text + reasons_of_gaps(lines, columns);
}

std::string not_measured(const std::vector<Job>& jobs, const std::vector<JobResult>& results) {
  std::string text;
  for (std::size_t i = 0; i < jobs.size(); ++i)
    if (results[i].state != JobState::done || !results[i].reason.empty())
      text += fmt::format("- {}: {}{}\n", jobs[i].id, to_string(results[i].state),
                          results[i].reason.empty() ? "" : ": " + table_cell(results[i].reason));
  return text.empty() ? "" : "\n## Not in the table\n\n" + text;
}

// Jobs that ran, grouped by what differs from the published settings.
std::string differences(const std::vector<Job>& jobs, const std::vector<JobResult>& results) {
  std::map<std::string, std::vector<std::string>> groups;
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    const Job& job = jobs[i];
    if (results[i].state != JobState::done) continue;
    std::vector<std::string> changes = changed_settings(job.published, job.settings);
    if (job.width && job.published_width && *job.width != *job.published_width)
      changes.insert(changes.begin(), fmt::format("images {} px wide (published: about {})", *job.width,
                                                  *job.published_width));
    if (!changes.empty()) groups[fmt::format("{}", fmt::join(changes, ", "))].push_back(job.id);
  }
  if (groups.empty()) return "\nAll runs have the published settings and image sizes.\n";
  std::string text =
      "\n**Not the published settings or image sizes**, so a difference to the paper is expected:\n\n";
  for (const auto& [change, ids] : groups)
    text += fmt::format("- {}: {}\n", fmt::join(ids, ", "), table_cell(change));
  return text;
}

std::string provenance(const std::vector<JobResult>& results) {
  std::set<std::string> origins;
  for (const JobResult& result : results) {
    if (result.state != JobState::done) continue;
    const Json& r = result.record;
    const Json device = r.value("device", Json::object());
    origins.insert(fmt::format("- {} ({}); ubs {}, build {}, commit {}",
                               device.value("name", "unknown device"), device.value("platform", "?"),
                               r.value("version", "?"), r.value("build", "?"), r.value("commit", "unknown")));
  }
  return origins.empty() ? "" : fmt::format("\nMeasured with:\n\n{}\n", fmt::join(origins, "\n"));
}

}  // namespace

std::string markdown(const ExperimentSpec& spec, const std::vector<Job>& jobs,
                     const std::vector<JobResult>& results, const Comparison& comparison,
                     const Occasion& occasion) {
  std::string text =
      fmt::format("# {}\n\n{}{}", spec.title, occasion.date.substr(0, 10),
                  occasion.scale_down > 1 ? fmt::format(", scaled down by {}", occasion.scale_down) : "");
  text += fmt::format(". Values of the model after the last iteration. Difference: ours minus paper.\n{}",
                      spec.source.empty() ? "" : fmt::format("Published values: {}\n", spec.source));
  if (!spec.notes.empty()) text += fmt::format("\n{}\n", spec.notes);
  text += differences(jobs, results);
  for (const DataEntry& entry : spec.data) text += set_table(entry.set, comparison);
  text += not_measured(jobs, results);
  text += "\n## Metrics and settings\n\n";
  for (const Metric& metric : columns_of(comparison.lines))
    text += fmt::format("- {}: {}\n", metric.name, metric.definition);
  text += provenance(results);
  return text + fmt::format(
                    "\n    {}\n\nAll settings of every run: `table.json`, and `config.yaml` in its folder.\n",
                    occasion.command);
}

std::string csv(const Comparison& comparison) {
  std::string text = "row,dataset,scene,state,metric,ours,published,difference\n";
  for (const Line& line : comparison.lines) {
    // Names are words without commas and quotes (read_name).
    const std::string start =
        fmt::format("{},{},{},{}", line.row, line.set, line.scene, to_string(line.state));
    for (const auto& [key, cell] : line.cells)
      text += fmt::format("{},{},{},{},{}\n", start, key, exact(cell.ours), exact(cell.published),
                          exact(cell.difference()));
    if (line.cells.empty()) text += start + ",,,,\n";
  }
  return text;
}

Json to_json(const ExperimentSpec& spec, const std::vector<Job>& jobs, const std::vector<JobResult>& results,
             const Comparison& comparison, const Occasion& occasion) {
  const auto value = [](const std::optional<double>& v) { return v ? Json(*v) : Json(nullptr); };
  Json definitions = Json::object(), runs = Json::array(), means = Json::array();
  for (const Metric& metric : metrics()) definitions[metric.key] = metric.definition;
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    TrainSettings settings = jobs[i].settings;
    const auto published =
        spec.rows[jobs[i].row].published.find(spec.data[jobs[i].set].set.name + "/" + jobs[i].scene);
    runs.push_back(
        {{"id", jobs[i].id},
         {"state", to_string(results[i].state)},
         {"reason", results[i].reason},
         {"lacks", results[i].lacks},
         {"data", jobs[i].data.string()},
         {"image_width", jobs[i].width ? Json(*jobs[i].width) : Json(nullptr)},
         {"ours", results[i].values},
         {"published",
          published == spec.rows[jobs[i].row].published.end() ? Json::object() : Json(published->second)},
         {"not_as_published", changed_settings(jobs[i].published, jobs[i].settings)},
         {"settings", ubs::to_json(bind_fields(settings, train_fields()))},
         {"record", results[i].record}});
  }
  for (const Line& line : comparison.lines) {
    if (line.scene != kAverage) continue;
    Json cells = Json::object();
    for (const auto& [key, cell] : line.cells)
      cells[key] = {{"ours", value(cell.ours)},
                    {"published", value(cell.published)},
                    {"difference", value(cell.difference())}};
    means.push_back({{"row", line.row},
                     {"dataset", line.set},
                     {"scenes_present", line.scenes_present},
                     {"scenes_planned", line.scenes_planned},
                     {"metrics", std::move(cells)}});
  }
  return {{"experiment", spec.name},           {"date", occasion.date},
          {"version", occasion.version},       {"build", occasion.build},
          {"commit", occasion.commit},         {"command", occasion.command},
          {"scale_down", occasion.scale_down}, {"published_source", spec.source},
          {"metrics", std::move(definitions)}, {"runs", std::move(runs)},
          {"means", std::move(means)},         {"published_averages", comparison.published_averages}};
}

}  // namespace ubs::experiment
