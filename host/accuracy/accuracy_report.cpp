// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/accuracy_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/accuracy/csv.hpp"
#include "host/base/json.hpp"
#include "host/report/svg_chart.hpp"

namespace ubs::accuracy {
namespace {

std::vector<std::string> distinct(std::span<const Result> results, std::string Result::*member) {
  std::vector<std::string> all;
  for (const Result& r : results)
    if (std::ranges::find(all, r.*member) == all.end()) all.push_back(r.*member);
  return all;
}

std::vector<const Result*> select(std::span<const Result> results, const std::string& device,
                                  const std::string& scene) {
  std::vector<const Result*> selected;
  for (const Result& r : results)
    if (r.device == device && r.scene == scene) selected.push_back(&r);
  return selected;
}

constexpr int kPlotWidth = 560, kPlotHeight = 400;
constexpr double kMaxDrawn = 2;  // time ratio in plots: beyond it all others would be one line

bool measured(const Result& r) { return r.note.empty() && !r.times.empty(); }

std::string marks(const Result& r) {
  return r.image_front && r.gradient_front ? "both"
         : r.image_front                   ? "image"
         : r.gradient_front                ? "gradient"
                                           : "";
}

void csv_rows(std::string& text, const Result& r, const StageErrors& errors, bool front) {
  const OperationTime& time = r.time(errors.operation);
  for (const NamedErrors& e : errors.quantities)
    text +=
        fmt::format("{},{},{},{},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.3g},{}\n", csv_field(r.device),
                    csv_field(r.scene), csv_field(r.configuration), csv_field(r.truth),
                    csv_field(errors.stage), csv_field(e.quantity), e.errors.relative, e.errors.typical,
                    e.errors.absolute, time.ms, time.ratio, time.uncertainty, front ? 1 : 0);
}

Json errors_json(const std::vector<NamedErrors>& errors) {
  Json all = Json::object();
  for (const NamedErrors& e : errors)
    all[e.quantity] = {
        {"relative", e.errors.relative}, {"typical", e.errors.typical}, {"max", e.errors.absolute}};
  return all;
}

std::string stage_cell(const Result& r, const std::string& stage) {
  const auto found = std::ranges::find(r.stages, stage, &StageErrors::stage);
  if (found == r.stages.end()) return "";
  const NamedErrors& e = worst(found->quantities);
  return fmt::format("{:.1e} {} ({:.2f})", e.errors.typical, e.quantity, r.time(found->operation).ratio);
}

// Points on the front from left to right, and all points with their numbers.
Html front_plot(const std::vector<const Result*>& results, bool image, const std::string& title) {
  ChartSeries front{.name = "front", .markers = true},
      others{.name = "not on the front", .colour = 1, .markers = true, .line = false},
      approximations{.name = "against another formula", .colour = 3, .markers = true, .line = false};
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t i = 0; i < results.size(); ++i)
    if (measured(*results[i])) order.emplace_back(results[i]->time(image ? "forward" : "iteration").ratio, i);
  std::ranges::sort(order);
  for (const auto& [time, i] : order) {
    const Result& r = *results[i];
    if (time > kMaxDrawn) continue;
    ChartSeries& to = r.truth != "same"                            ? approximations
                      : (image ? r.image_front : r.gradient_front) ? front
                                                                   : others;
    to.x.push_back(time);
    to.y.push_back(image ? r.image_error() : r.gradient_error().errors.typical);
    to.labels.push_back(std::to_string(i + 1));
  }
  std::vector<ChartSeries> series{front, others};
  if (!approximations.x.empty()) series.push_back(approximations);
  return svg_chart(
      {.title = title,
       .x_label = image ? "time of forward / default" : "time of an iteration / default",
       .y_label = image ? "relative error of the image" : "relative error of the gradient, 99 % of splats",
       .log_y = true,
       .legend = true,
       .width = kPlotWidth,
       .height = kPlotHeight},
      series);
}

std::string legend(const std::vector<const Result*>& results) {
  std::string text;
  for (std::size_t i = 0; i < results.size(); ++i)
    text += fmt::format("{}{} {}", i == 0 ? "" : ", ", i + 1, results[i]->configuration);
  return text;
}

std::string headline_scene(std::span<const Result> results) {
  const std::vector<std::string> scenes = scenes_of(results);
  return std::ranges::find(scenes, "all") != scenes.end() ? "all" : scenes.front();
}

}  // namespace

std::vector<std::string> devices_of(std::span<const Result> results) {
  return distinct(results, &Result::device);
}
std::vector<std::string> scenes_of(std::span<const Result> results) {
  return distinct(results, &Result::scene);
}

std::string result_table(std::span<const Result> results, const std::string& device,
                         const std::string& scene) {
  std::string text =
      "| # | configuration | truth | image | image max | gradient, 99 % (worst group) | all splats | own L1 "
      "signs | forward ms "
      "| ratio | iteration ms | "
      "ratio | front |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  std::size_t number = 0;
  for (const Result* r : select(results, device, scene)) {
    ++number;
    if (!measured(*r)) {
      text += fmt::format("| {} | {} | | {} | | | | | | | | | |\n", number, r->configuration,
                          r->note.empty() ? "not timed" : r->note);
      continue;
    }
    const NamedErrors& gradient = r->gradient_error();
    const OperationTime &forward = r->time("forward"), &iteration = r->time("iteration");
    text += fmt::format(
        "| {} | {} | {} | {:.2e} | {:.1e} | {:.2e} {} | {:.1e} | {:.1e} | {:.2f} | {:.3f} | {:.2f} | {:.3f} "
        "| {} |\n",
        number, r->configuration, r->truth, r->image_error(), r->image.quantities[0].errors.absolute,
        gradient.errors.typical, scene == "all" ? "" : gradient.quantity,
        most_relative(r->gradient.quantities), most_relative(r->loss_gradient.quantities), forward.ms,
        forward.ratio, iteration.ms, iteration.ratio, marks(*r));
  }
  return text;
}

std::string stage_table(std::span<const Result> results, const std::string& device,
                        const std::string& scene) {
  std::vector<std::string> stages;
  for (const Result& r : results)
    for (const StageErrors& s : r.stages)
      if (std::ranges::find(stages, s.stage) == stages.end()) stages.push_back(s.stage);
  if (stages.empty()) return "";
  std::string text = "| configuration |", line = "|---|";
  for (const std::string& stage : stages) {
    text += fmt::format(" {} |", stage);
    line += "---|";
  }
  text += "\n" + line + "\n";
  for (const Result* r : select(results, device, scene)) {
    if (!measured(*r) || r->stages.empty()) continue;
    text += "| " + r->configuration + " |";
    for (const std::string& stage : stages) text += fmt::format(" {} |", stage_cell(*r, stage));
    text += "\n";
  }
  return text;
}

std::string accuracy_csv(std::span<const Result> results) {
  std::string text =
      "device,scene,configuration,truth,stage,quantity,relative_error,typical_error,max_error,median_ms,time_"
      "ratio,time_"
      "uncertainty,"
      "front\n";
  for (const Result& r : results) {
    if (!measured(r)) continue;
    csv_rows(text, r, r.image, r.image_front);
    csv_rows(text, r, r.gradient, r.gradient_front);
    csv_rows(text, r, r.loss_gradient, false);
    for (const StageErrors& s : r.stages) csv_rows(text, r, s, false);
  }
  return text;
}

nlohmann::ordered_json accuracy_json(std::span<const Result> results) {
  Json all = Json::array();
  for (const Result& r : results) {
    Json json{
        {"device", r.device}, {"scene", r.scene}, {"configuration", r.configuration}, {"truth", r.truth}};
    if (!measured(r)) {
      json["note"] = r.note;
      all.push_back(std::move(json));
      continue;
    }
    json["image"] = errors_json(r.image.quantities)["image"];
    json["image_front"] = r.image_front;
    json["gradient"] = errors_json(r.gradient.quantities);
    json["gradient_front"] = r.gradient_front;
    json["loss_gradient"] = errors_json(r.loss_gradient.quantities);
    json["stages"] = Json::object();
    for (const StageErrors& s : r.stages) json["stages"][s.stage] = errors_json(s.quantities);
    json["times"] = Json::object();
    for (const OperationTime& t : r.times)
      json["times"][t.operation] = {{"median_ms", t.ms}, {"ratio", t.ratio}, {"uncertainty", t.uncertainty}};
    all.push_back(std::move(json));
  }
  return all;
}

std::string accuracy_page(std::span<const Result> results, const ReportHeader& header) {
  std::string page = "# Accuracy against time\n\n";
  for (const std::string& line : header.lines) page += line + "\n";
  page += fmt::format("\n![error against time]({})\n", header.plot);
  std::vector<std::string> scenes = scenes_of(results);
  std::ranges::stable_partition(scenes, [](const std::string& s) { return s == "all"; });
  for (const std::string& device : devices_of(results)) {
    page += fmt::format("\nNumbers in the plot, which ends at {} times the time of the default: {}.\n",
                        kMaxDrawn, legend(select(results, device, scenes.front())));
    for (const std::string& scene : scenes) {
      page += fmt::format(
          "\n## {}{}\n\n{}", scene == "all" ? "Geometric means over the scenes" : "Scene " + scene,
          devices_of(results).size() > 1 ? ", " + device : "", result_table(results, device, scene));
      if (const std::string stages = scene == "all" ? "" : stage_table(results, device, scene);
          !stages.empty())
        page +=
            "\nStage by stage on exact inputs: largest relative error, quantity, (time ratio).\n\n" + stages;
    }
  }
  return page;
}

std::string accuracy_plot(std::span<const Result> results) {
  std::vector<Html> plots;
  const std::string scene = headline_scene(results);
  for (const std::string& device : devices_of(results)) {
    const auto selected = select(results, device, scene);
    const std::string where = scene == "all" ? "means over scenes" : scene;
    const std::string name = device.substr(0, 40);
    plots.push_back(front_plot(selected, true, "Image, " + where + ", " + name));
    plots.push_back(front_plot(selected, false, "Gradient, " + where + ", " + name));
  }
  return svg_sheet(plots, 2, kPlotWidth, kPlotHeight);
}

}  // namespace ubs::accuracy
