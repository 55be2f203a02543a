// SPDX-License-Identifier: Apache-2.0
// The numbers of comparison.hpp; their texts are in comparison_text.cpp.
#include "host/experiment/comparison.hpp"

namespace ubs::experiment {
namespace {

std::optional<double> find(const std::map<std::string, double>& values, const char* key) {
  const auto at = values.find(key);
  return at == values.end() ? std::nullopt : std::optional(at->second);
}

Line scene_line(const ExperimentSpec& spec, const Job& job, const JobResult& result) {
  const RowSpec& row = spec.rows[job.row];
  const DataEntry& entry = spec.data[job.set];
  Line line{row.name,     entry.set.name, job.scene, row.label, entry.set.find(job.scene)->title,
            result.state, result.reason,  {}};
  const auto published = row.published.find(entry.set.name + "/" + job.scene);
  for (const Metric& metric : metrics()) {
    Cell cell{find(result.values, metric.key), {}};
    if (published != row.published.end()) cell.published = find(published->second, metric.key);
    if (cell.ours || cell.published) line.cells[metric.key] = cell;
    if (const auto lacking = result.lacks.find(metric.key); lacking != result.lacks.end() && !cell.ours)
      line.lacks.insert(*lacking);
  }
  return line;
}

Cell mean_cell(const std::vector<Line>& lines, const char* key) {
  double ours = 0, published = 0, all = 0;
  std::size_t both = 0, measured = 0;
  for (const Line& line : lines) {
    const auto at = line.cells.find(key);
    if (at == line.cells.end() || !at->second.ours) continue;
    all += *at->second.ours;
    ++measured;
    if (!at->second.published) continue;
    ours += *at->second.ours;
    published += *at->second.published;
    ++both;
  }
  if (measured == 0) return {};
  if (both == 0) return {all / static_cast<double>(measured), {}};
  return {ours / static_cast<double>(both), published / static_cast<double>(both)};
}

Line mean_line(const std::vector<Line>& lines, std::size_t planned) {
  Line mean{lines[0].row, lines[0].set, kAverage, lines[0].label, "mean", JobState::done, "", {}};
  mean.scenes_planned = planned;
  for (const Line& line : lines) mean.scenes_present += line.state == JobState::done;
  for (const Metric& metric : metrics())
    if (const Cell cell = mean_cell(lines, metric.key); cell.ours) mean.cells[metric.key] = cell;
  return mean;
}

}  // namespace

std::optional<double> Cell::difference() const {
  if (!ours || !published) return std::nullopt;
  return *ours - *published;
}

Comparison compare(const ExperimentSpec& spec, const std::vector<Job>& jobs,
                   const std::vector<JobResult>& results) {
  Comparison comparison;
  for (std::size_t d = 0; d < spec.data.size(); ++d)
    for (std::size_t r = 0; r < spec.rows.size(); ++r) {
      std::vector<Line> lines;
      for (std::size_t i = 0; i < jobs.size(); ++i)
        if (jobs[i].set == d && jobs[i].row == r) lines.push_back(scene_line(spec, jobs[i], results[i]));
      if (lines.empty()) continue;
      const std::size_t planned = spec.data[d].scenes.size();
      comparison.lines.insert(comparison.lines.end(), lines.begin(), lines.end());
      if (planned > 1) comparison.lines.push_back(mean_line(lines, planned));
      const std::string set = spec.data[d].set.name;
      if (const auto at = spec.rows[r].published.find(set + "/" + kAverage);
          at != spec.rows[r].published.end())
        comparison.published_averages[spec.rows[r].name + "/" + set] = at->second;
    }
  return comparison;
}

}  // namespace ubs::experiment
