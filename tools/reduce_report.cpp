// SPDX-License-Identifier: Apache-2.0
#include "tools/reduce_report.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "host/base/memory_limit.hpp"

namespace ubs::tools {
namespace {

// Describes what removing dimensions would change, for the splats that are visible in some view.
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

Json to_json(const ReductionReport& r) {
  Json json{{"bound", r.bound},
            {"lossless", {{"unseen_splats", r.after->unseen}, {"inert_dimensions", r.after->inert}}},
            {"lossy", {{"dropped_splats", r.after->dropped}, {"turned_splats", r.after->turned_count}}},
            {"before", model_json(*r.before, r.bytes_before, r.times[0])},
            {"after", model_json(r.after->model, r.bytes_after, r.times[1])}};
  for (const SplitChange& split : r.splits)
    json[split.name] = {
        {"views", split.views}, {"before", quality_json(split.before)}, {"after", quality_json(split.after)}};
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
  for (const SplitChange& s : r.splits) {
    row(s.name + " PSNR [dB]", fmt::format("{:.3f}", s.before.psnr_channel_mean),
        fmt::format("{:.3f}", s.after.psnr_channel_mean),
        fmt::format("{:+.3f} dB", s.after.psnr_channel_mean - s.before.psnr_channel_mean));
    row(s.name + " SSIM", fmt::format("{:.4f}", s.before.ssim), fmt::format("{:.4f}", s.after.ssim));
  }
  say("lossless  {} splats removed (not visible in any training view), {} reduced to fewer dimensions (the "
      "removed dimensions have no effect)\n",
      after.unseen, after.inert);
  if (r.bound > 0)
    say("lossy     {} splats removed, {} reduced to fewer dimensions (weight bound {:.3g})\n", after.dropped,
        after.turned_count, r.bound);
}

void print_summary(const ReductionReport& r, const std::string& file) {
  const SplitChange& seen = r.splits.back();
  say("{}: {} of {} splats, {:.2f} of {:.2f} MB, PSNR of the {} views {:.2f} -> {:.2f} dB\n", file,
      r.after->model.count(), r.before->count(), static_cast<double>(r.bytes_after) / 1e6,
      static_cast<double>(r.bytes_before) / 1e6, seen.name, seen.before.psnr_channel_mean,
      seen.after.psnr_channel_mean);
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
