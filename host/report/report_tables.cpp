// SPDX-License-Identifier: Apache-2.0
// Tables of the page of `ubs report`: measurements, times, memory; one column a run, and where
// there are several, how far each is from the first.
#include <fmt/format.h>

#include <algorithm>

#include "host/base/json.hpp"
#include "host/base/memory_limit.hpp"
#include "host/report/report_sections.hpp"

namespace ubs {
namespace {

using Path = std::vector<std::string>;

enum class Better { neither, high, low };

struct Quantity {
  std::string name, unit;
  Path path;  // of metrics.json
  double scale = 1;
  int decimals = 2;
  Better better = Better::neither;
};

std::string fixed(double value, int decimals) { return fmt::format("{:.{}f}", value, decimals); }

TableCell number(std::string_view content) { return {text(content), "number"}; }

Html difference(double value, double first, const Quantity& q) {
  const double by = value - first;
  const std::string shown = fmt::format("{:+.{}f}", by, q.decimals);
  const bool zero = shown.find_first_of("123456789") == std::string::npos;
  const bool good = q.better == Better::high ? by > 0 : by < 0;
  const char* style = zero || q.better == Better::neither ? "same" : good ? "better" : "worse";
  return raw(" ") + tag("span", {{"class", style}}, text(shown));
}

// One cell a run, numbers in a column where there is something to compare; empty where no run has it.
TableRow quantity_row(const ReportRuns& runs, const Quantity& q) {
  TableRow row{plain(q.unit.empty() ? q.name : q.name + " [" + q.unit + "]")};
  const std::optional<double> first = runs[0].record.number(q.path);
  bool any = false;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const std::optional<double> value = runs[r].record.number(q.path);
    any = any || value;
    Html content = text(value ? fixed(*value * q.scale, q.decimals) : kNothing);
    if (r > 0 && value && first) content += difference(*value * q.scale, *first * q.scale, q);
    row.push_back({content, runs.size() > 1 ? "number" : ""});
  }
  return any ? row : TableRow{};
}

// `add`: names of the measures of the test views, as the runs have them.
std::vector<std::string> measure_names(const ReportRuns& runs) {
  std::vector<std::string> names;
  for (const ReportRun& run : runs)
    if (const Json* mean = run.record.find({"test", "mean"}); mean && mean->is_object())
      for (const auto& [key, value] : mean->items())
        if (std::find(names.begin(), names.end(), key) == names.end()) names.push_back(key);
  return names;
}

Quantity measure(const std::string& name) {
  if (name == "psnr") return {"PSNR, mean over channels", "dB", {}, 1, 3, Better::high};
  if (name == "psnr_joint") return {"PSNR, joint", "dB", {}, 1, 3, Better::high};
  if (name == "ssim") return {"SSIM", "", {}, 1, 4, Better::high};
  if (name == "ssim_valid") return {"SSIM, inside windows", "", {}, 1, 4, Better::high};
  return {name, "", {}, 1, 5, name.starts_with("lpips") ? Better::low : Better::neither};
}

std::vector<Quantity> summary_quantities(const ReportRuns& runs) {
  std::vector<Quantity> all;
  for (const std::string& name : measure_names(runs)) {
    all.push_back(measure(name));
    all.back().path = {"test", "mean", name};
  }
  const std::vector<Quantity> rest{
      {"splats", "", {"splats"}, 1, 0},
      {"dimensions N", "", {"dim"}, 1, 0},
      {"iterations", "", {"iterations"}, 1, 0},
      {"training", "s", {"seconds"}, 1, 1, Better::low},
      {"step", "ms", {"actual", "step_ms"}, 1, 3, Better::low},
      {"intersections of a view, mean", "", {"actual", "mean_intersections"}, 1, 0},
      {"intersections of a view, most", "", {"actual", "most_intersections"}, 1, 0},
      {"model file", "MiB", {"storage_bytes"}, 1 / kMiB, 2, Better::low},
      {"device memory at most", "MiB", {"peak_device_bytes"}, 1 / kMiB, 1, Better::low},
      {"device memory, planned from the start", "MiB", {"predicted_device_bytes"}, 1 / kMiB, 1},
      {"extent of the cameras", "scene units", {"extent"}, 1, 3},
      {"roll-backs", "", {"rollbacks"}, 1, 0, Better::low},
      {"splats dropped", "", {"dropped_splats"}, 1, 0, Better::low},
      {"resumed from iteration", "", {"resumed_from"}, 1, 0}};
  all.insert(all.end(), rest.begin(), rest.end());
  return all;
}

std::string state_of(const RunRecord& run) {
  if (run.metrics.is_null()) return "not finished";
  const Json* interrupted = run.find({"interrupted"});
  return interrupted && interrupted->is_boolean() && interrupted->get<bool>() ? "interrupted" : "finished";
}

// Of a key that ends in _bytes: as MiB.
std::string value_text(const Json& value, const std::string& key) {
  if (value.is_null()) return kNothing;
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number() && key.ends_with("_bytes"))
    return fmt::format("{:.1f} MiB", value.get<double>() / kMiB);
  return json_text(value);
}

}  // namespace

TableRow text_row(const ReportRuns& runs, const std::string& name, const std::vector<std::string>& path) {
  TableRow row{plain(name)};
  for (const ReportRun& run : runs) {
    const Json* found = run.record.find(path);
    row.push_back(plain(found ? value_text(*found, path.back()) : kNothing));
  }
  return row;
}

namespace {

Html card(std::string_view value, std::string_view name) {
  return tag("div", {{"class", "card"}}, tag("b", text(value)) + tag("span", text(name)));
}

Html cards(const RunRecord& run) {
  Html out;
  const auto add = [&](const Path& path, double scale, int decimals, const char* unit, const char* name) {
    if (const auto value = run.number(path)) out += card(fixed(*value * scale, decimals) + unit, name);
  };
  add({"test", "mean", "psnr"}, 1, 2, " dB", "PSNR of the test views");
  add({"test", "mean", "fitted_pose", "psnr"}, 1, 2, " dB", "from the poses that fit best");
  add({"test", "mean", "ssim"}, 1, 4, "", "SSIM");
  add({"splats"}, 1, 0, "", "splats");
  add({"dim"}, 1, 0, "", "dimensions");
  add({"iterations"}, 1, 0, "", "iterations");
  add({"seconds"}, 1, 1, " s", "training");
  add({"storage_bytes"}, 1 / kMiB, 2, " MiB", "model file");
  return tag("div", {{"class", "cards"}}, out + card(state_of(run), "state"));
}

Html summary_table(const ReportRuns& runs) {
  std::vector<TableRow> rows;
  TableRow states{plain("state")};
  for (const ReportRun& run : runs) states.push_back(plain(state_of(run.record)));
  for (const Quantity& q : summary_quantities(runs))
    if (TableRow row = quantity_row(runs, q); !row.empty()) rows.push_back(std::move(row));
  rows.insert(rows.begin(), std::move(states));
  for (const auto& [name, path] : {std::pair{"data", Path{"data"}},
                                   {"layout", Path{"data_report", "layout"}},
                                   {"device", Path{"device", "name"}},
                                   {"version", Path{"version"}},
                                   {"build", Path{"build"}}})
    rows.push_back(text_row(runs, name, path));
  return table(head_row(runs, ""), rows);
}

const Json* measured_view(const RunRecord& run, const std::string& name) {
  const Json* views = run.find({"test", "views"});
  if (!views || !views->is_array()) return nullptr;
  for (const Json& view : *views)
    if (view.is_object() && view.contains("name") && view["name"] == name) return &view;
  return nullptr;
}

}  // namespace

Html view_facts(const RunRecord& run, const std::string& view) {
  const Json* measured = measured_view(run, view);
  if (!measured) return {};
  std::vector<TableRow> rows;
  for (const auto& [key, value] : measured->items())
    if (value.is_number())
      rows.push_back({plain(measure(key).name), number(fixed(value.get<double>(), measure(key).decimals))});
  return tag("figure", {{"class", "facts"}},
             tag("figcaption", text("measured at the end of training")) + table({}, rows));
}

namespace {

std::vector<std::string> measured_names(const ReportRuns& runs) {
  std::vector<std::string> names;
  for (const ReportRun& run : runs)
    if (const Json* views = run.record.find({"test", "views"}); views && views->is_array())
      for (const Json& view : *views)
        if (view.is_object() && view.contains("name") && view["name"].is_string())
          if (auto name = view["name"].get<std::string>();
              std::find(names.begin(), names.end(), name) == names.end())
            names.push_back(std::move(name));
  return names;
}

// Several runs: the first two measures of each, which is PSNR.
Html view_table(const ReportRuns& runs) {
  const std::vector<std::string> names = measured_names(runs), measures = measure_names(runs);
  if (names.empty()) return {};
  TableRow head{plain("view")};
  std::vector<std::pair<std::size_t, std::string>> columns;
  for (std::size_t r = 0; r < runs.size(); ++r)
    for (const std::string& m : measures) {
      if (runs.size() > 1 && m != "psnr" && m != "ssim") continue;
      columns.emplace_back(r, m);
      head.push_back(
          {(runs.size() > 1 ? run_label(runs, r) + raw(" ") : Html{}) + text(measure(m).name), "number"});
    }
  std::vector<TableRow> rows;
  for (const std::string& name : names) {
    TableRow row{plain(name)};
    for (const auto& [r, m] : columns) {
      const Json* view = measured_view(runs[r].record, name);
      const bool known = view && view->contains(m) && (*view)[m].is_number();
      row.push_back(number(known ? fixed((*view)[m].get<double>(), measure(m).decimals) : kNothing));
    }
    rows.push_back(std::move(row));
  }
  return tag("details", Attributes{{"open", ""}},
             tag("summary", text(fmt::format("Test views ({})", names.size()))) + table(head, rows));
}

Html stage_table(const ReportRuns& runs) {
  std::vector<std::string> stages;
  for (const ReportRun& run : runs)
    if (const Json* minutes = run.record.find({"minutes", "stages"}); minutes && minutes->is_object())
      for (const auto& [key, value] : minutes->items())
        if (std::find(stages.begin(), stages.end(), key) == stages.end()) stages.push_back(key);
  if (stages.empty()) return {};
  std::vector<TableRow> rows;
  for (const std::string& stage : stages) {
    TableRow row{plain(stage)};
    for (std::size_t r = 0; r < runs.size(); ++r) {
      const auto minutes = runs[r].record.number({"minutes", "stages", stage}),
                 total = runs[r].record.number({"minutes", "total"});
      if (!minutes || !total) {
        row.push_back(number(kNothing));
        continue;
      }
      const double percent = *total > 0 ? std::clamp(100 * *minutes / *total, 0.0, 100.0) : 0;
      const Html bar =
          tag("rect",
              {{"class", "bar " + run_colour(r)}, {"width", fmt::format("{:.1f}", percent)}, {"height", "1"}},
              {});
      row.push_back(
          {text(fmt::format("{:.2f} s, {:.1f} %", 60 * *minutes, percent)) +
               tag("svg", {{"class", "track"}, {"viewBox", "0 0 100 1"}, {"preserveAspectRatio", "none"}},
                   bar),
           "number"});
    }
    rows.push_back(std::move(row));
  }
  return tag("h3", text("Time by stage")) +
         paragraph(
             "note",
             text(
                 "Estimated from sampled iterations; other is images, the host, what runs between stages.")) +
         table(head_row(runs, "stage"), rows);
}

// What the loader of the data had to say.
Html data_notes(const ReportRuns& runs) {
  Html items;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const Html label = runs.size() > 1 ? run_label(runs, r) + raw(" ") : Html{};
    if (const Json* notes = runs[r].record.find({"data_report", "notes"}); notes && notes->is_array())
      for (const Json& note : *notes)
        if (note.is_string()) items += tag("li", label + text(note.get<std::string>()));
    if (const Json* skipped = runs[r].record.find({"data_report", "skipped"}); skipped && skipped->is_array())
      for (const Json& s : *skipped)
        if (s.is_object())
          items += tag("li", label + text(fmt::format("{} skipped: {}", s.value("count", Json()).dump(),
                                                      s.contains("why") && s["why"].is_string()
                                                          ? s["why"].get<std::string>()
                                                          : "")));
  }
  return items.empty() ? Html{} : tag("h3", text("Loading the data")) + tag("ul", items);
}

}  // namespace

Section summary_section(const ReportRuns& runs) {
  Html out;
  if (runs.size() == 1) out += cards(runs[0].record);
  if (runs.size() > 1)
    out += paragraph("note", text("Small figures: difference to the first run, green where that is better."));
  return {"summary", "Summary", out + summary_table(runs)};
}

Section measurements_section(const ReportRuns& runs) {
  return {"measurements", "Measurements", view_table(runs) + stage_table(runs) + data_notes(runs)};
}

}  // namespace ubs
