// SPDX-License-Identifier: Apache-2.0
// See reduce_report.hpp.
#include "tools/reduce_report.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "host/base/memory_limit.hpp"

namespace ubs::tools {
namespace {

struct BoundSummary {
  double measured_max = 0, measured_rms = 0, bound_max = 0, bound_rms = 0, worst_ratio = 0;
  std::size_t beyond = 0;
};

BoundSummary summarise(const SplitChange& split) {
  BoundSummary s;
  for (const reduce::ViewChange& view : split.views) {
    const double share = 1 / static_cast<double>(split.views.size());
    s.measured_max = std::max(s.measured_max, view.measured_max);
    s.bound_max = std::max(s.bound_max, view.bound_max);
    s.worst_ratio = std::max(s.worst_ratio, view.worst_ratio);
    s.measured_rms += share * view.measured_rms * view.measured_rms;
    s.bound_rms += share * view.bound_rms * view.bound_rms;
    s.beyond += view.beyond_bound;
  }
  s.measured_rms = std::sqrt(s.measured_rms);
  s.bound_rms = std::sqrt(s.bound_rms);
  return s;
}

// What the smaller dimensions would change, over the splats that some view sees.
Json effects_json(const reduce::Reducer& reducer) {
  struct Columns {
    std::vector<double> opacity, shift, change;
    std::size_t exact = 0;
  };
  std::map<int, Columns> by_dim;
  for (const auto& candidates : reducer.replacements())
    for (const reduce::Replacement& candidate : candidates) {
      Columns& columns = by_dim[candidate.dim];
      columns.opacity.push_back(candidate.effect.opacity);
      columns.shift.push_back(candidate.effect.shift_px);
      columns.change.push_back(candidate.effect.change);
      columns.exact += candidate.effect.exact;
    }
  Json json = Json::array();
  for (auto& [dim, columns] : by_dim)
    json.push_back({{"dim", dim},
                    {"splats", columns.change.size()},
                    {"exact", columns.exact},
                    {"opacity_factor_range", quantiles_json(std::move(columns.opacity))},
                    {"shift_px", quantiles_json(std::move(columns.shift))},
                    {"weight_change", quantiles_json(std::move(columns.change))}});
  return json;
}

Json model_json(const MixedModel& model, std::size_t bytes, const reduce::ModelTimes& times) {
  return {{"splats", model.count()},
          {"groups", groups_json(model)},
          {"parameters", model.parameters()},
          {"bytes", bytes},
          {"render_ms", times.render_ms.median},
          {"render_ms_minimum", times.render_ms.minimum},
          {"step_ms", times.step_ms.median},
          {"step_ms_minimum", times.step_ms.minimum}};
}

Json split_json(const SplitChange& split) {
  const BoundSummary s = summarise(split);
  Json json{{"views", split.views.size()},
            {"identical_views", identical_views(split)},
            {"measured_change_max", s.measured_max},
            {"measured_change_rms", s.measured_rms},
            {"bound_max", s.bound_max},
            {"bound_rms", s.bound_rms},
            {"largest_measured_to_bound", s.worst_ratio},
            {"values_beyond_bound", s.beyond}};
  if (split.with_metrics) {
    json["before"] = quality_json(split.before);
    json["after"] = quality_json(split.after);
  }
  return json;
}

std::string ratio_text(double before, double after) {
  return before > 0 ? fmt::format("{:+.1f} %", 100 * (after / before - 1)) : "";
}

void row(const std::string& name, const std::string& before, const std::string& after,
         const std::string& remark = "") {
  say("{:<22}{:>14}{:>14}   {}\n", name, before, after, remark);
}

void number_row(const std::string& name, double before, double after, int digits) {
  row(name, fmt::format("{:.{}f}", before, digits), fmt::format("{:.{}f}", after, digits),
      ratio_text(before, after));
}

void print_groups(const ReductionReport& report) {
  std::map<int, std::array<std::size_t, 2>, std::greater<>> counts;
  for (const SplatModel& group : report.before->groups) counts[group.dim][0] += group.count;
  for (const SplatModel& group : report.after->model.groups) counts[group.dim][1] += group.count;
  for (const auto& [dim, pair] : counts)
    row(fmt::format("  N = {}", dim), std::to_string(pair[0]), std::to_string(pair[1]));
}

}  // namespace

bool bound_holds(const ReductionReport& report) {
  return std::ranges::all_of(report.splits,
                             [](const SplitChange& split) { return summarise(split).beyond == 0; });
}

std::size_t identical_views(const SplitChange& split) {
  return static_cast<std::size_t>(
      std::ranges::count_if(split.views, [](const reduce::ViewChange& view) { return view.identical; }));
}

Json to_json(const ReductionReport& r) {
  Json json{{"bound", r.bound},
            {"lossless", {{"unseen_splats", r.after->unseen}, {"inert_dimensions", r.after->inert}}},
            {"lossy", {{"dropped_splats", r.after->dropped}, {"turned_splats", r.after->turned_count}}},
            {"before", model_json(*r.before, r.bytes_before, r.times[0])},
            {"after", model_json(r.after->model, r.bytes_after, r.times[1])},
            {"bound_holds", bound_holds(r)}};
  for (const SplitChange& split : r.splits) json[split.name] = split_json(split);
  json["effects"] = effects_json(*r.reducer);
  json["search"] = Json::array();
  for (const SearchStep& step : r.search)
    json["search"].push_back(
        {{"bound", step.bound}, {"loss_db", step.loss_db}, {"parameters", step.parameters}});
  return json;
}

void print_table(const ReductionReport& r) {
  const reduce::Reduced& after = *r.after;
  row("", "before", "after");
  row("splats", std::to_string(r.before->count()), std::to_string(after.model.count()),
      ratio_text(static_cast<double>(r.before->count()), static_cast<double>(after.model.count())));
  print_groups(r);
  number_row("file [MiB]", mib(r.bytes_before), mib(r.bytes_after), 3);
  number_row("render [ms]", r.times[0].render_ms.median, r.times[1].render_ms.median, 2);
  number_row("training step [ms]", r.times[0].step_ms.median, r.times[1].step_ms.median, 2);
  for (const SplitChange& s : r.splits)
    if (s.with_metrics) {
      row(s.name + " PSNR [dB]", fmt::format("{:.3f}", s.before.psnr_channel_mean),
          fmt::format("{:.3f}", s.after.psnr_channel_mean),
          fmt::format("{:+.3f} dB", s.after.psnr_channel_mean - s.before.psnr_channel_mean));
      row(s.name + " SSIM", fmt::format("{:.4f}", s.before.ssim), fmt::format("{:.4f}", s.after.ssim));
    }
  say("lossless  {} splats that no training view sees, {} with dimensions without effect\n", after.unseen,
      after.inert);
  if (r.bound > 0)
    say("lossy     weight bound {:.3g}: {} splats given up, {} turned into fewer dimensions\n", r.bound,
        after.dropped, after.turned_count);
  for (const SplitChange& s : r.splits) {
    const BoundSummary b = summarise(s);
    say("{:<9} change of pixels: largest {:.4g} (bound {:.4g}), rms {:.3g} (bound {:.3g}); {} of {} views "
        "identical; {}\n",
        s.name, b.measured_max, b.bound_max, b.measured_rms, b.bound_rms, identical_views(s), s.views.size(),
        b.beyond == 0 ? "within the bound everywhere" : fmt::format("{} VALUES BEYOND THE BOUND", b.beyond));
  }
}

std::string effects_csv(const ReductionReport& r) {
  std::vector<int> dims;
  for (const SplatModel& group : r.before->groups)
    for (const int dim : reduce::smaller_dims(group.dim))
      if (std::ranges::find(dims, dim) == dims.end()) dims.push_back(dim);
  std::ranges::sort(dims);
  std::string text = "splat,dim,views,weight";
  for (const int dim : dims) text += fmt::format(",opacity_range_{0},shift_px_{0},weight_change_{0}", dim);
  text += "\n";
  const reduce::Contributions& contributions = r.reducer->contributions();
  std::size_t i = 0;
  for (const SplatModel& group : r.before->groups)
    for (std::size_t k = 0; k < group.count; ++k, ++i) {
      text += fmt::format("{},{},{},{:.6g}", i, group.dim, contributions.in_views[i], contributions.most[i]);
      for (const int dim : dims) {
        const auto& candidates = r.reducer->replacements()[i];
        const auto found = std::ranges::find(candidates, dim, &reduce::Replacement::dim);
        text += found == candidates.end() ? std::string(",,,")
                                          : fmt::format(",{:.6g},{:.6g},{:.6g}", found->effect.opacity,
                                                        found->effect.shift_px, found->effect.change);
      }
      text += "\n";
    }
  return text;
}

}  // namespace ubs::tools
