// SPDX-License-Identifier: Apache-2.0
// Our results beside the published ones: the numbers, and their forms as Markdown, CSV and JSON.
#pragma once

#include "host/experiment/job_folder.hpp"

namespace ubs::experiment {

struct Cell {
  std::optional<double> ours, published;
  std::optional<double> difference() const;  // ours - published, where both are known
};

struct Line {
  std::string row, set, scene;  // names; scene is kAverage for means
  std::string label, title;     // of row and scene, for people
  JobState state = JobState::done;
  std::string reason;
  std::map<std::string, Cell> cells;           // by Metric::key
  std::map<std::string, std::string> lacks{};  // by Metric::key: why ours is not known
  // Of means: over how many of how many scenes. Both values of a cell are means over the same scenes, those
  // with both values, so that a missing scene does not shift the difference; without any published value
  // the mean is over all measured scenes.
  std::size_t scenes_present = 0, scenes_planned = 0;
};

struct Comparison {
  std::vector<Line> lines;  // by data set, then row, then scene; after the scenes of a row their mean
  // The mean that the publication prints, over all scenes of the set, by "row/set" and metric.
  std::map<std::string, std::map<std::string, double>> published_averages;
};

Comparison compare(const ExperimentSpec& spec, const std::vector<Job>& jobs,
                   const std::vector<JobResult>& results);

struct Occasion {
  std::string date, version, build, commit, command;
  int scale_down = 1;
};

std::string markdown(const ExperimentSpec& spec, const std::vector<Job>& jobs,
                     const std::vector<JobResult>& results, const Comparison& comparison,
                     const Occasion& occasion);
// Long form: row, dataset, scene, state, metric, ours, published, difference; means have the scene "average".
std::string csv(const Comparison& comparison);
Json to_json(const ExperimentSpec& spec, const std::vector<Job>& jobs, const std::vector<JobResult>& results,
             const Comparison& comparison, const Occasion& occasion);

}  // namespace ubs::experiment
