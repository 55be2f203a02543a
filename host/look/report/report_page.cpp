// SPDX-License-Identifier: Apache-2.0
// See report_page.hpp.
#include "host/look/report/report_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/look/report/histogram.hpp"
#include "host/look/report/page_picture.hpp"
#include "host/look/report/splat_values.hpp"
#include "host/settings/fields.hpp"

namespace ubs {
namespace {

constexpr int kLongestSide = 1000, kLongestPart = 640, kLongestTime = 320;
// Errors of this size or above get the brightest colour. If the scale reached up to an error of 1, most
// errors would look black.
constexpr double kErrorTop = 0.25;
constexpr std::size_t kBins = 48;
// Share of the values that may be beyond each end of the axis of a histogram.
constexpr double kOutside = 0.005;

using ReportRuns = std::vector<ReportRun>;

// PictureList contains the images of a page. The record refers to an image by its index in this list.
class PictureList {
 public:
  std::size_t add(const Image8& image, int longest) {
    uris_.push_back(page_picture(image, longest));
    return uris_.size() - 1;
  }
  const Json& uris() const { return uris_; }

 private:
  Json uris_ = Json::array();
};

Json run_json(const ReportRun& run) {
  // Inserting with operator[] would search all keys, which come from the run. They are all different.
  Json settings = Json::object();
  auto& members = settings.get_ref<Json::object_t&>();
  for (const auto& [key, value] : run.record.setting_texts) members.emplace_back(key, value);
  return {{"name", run.record.name},       {"folder", run.record.folder.string()},
          {"remarks", run.record.remarks}, {"metrics", run.record.metrics},
          {"settings", settings},          {"log", run.record.log},
          {"views_from", run.views_from},  {"drawn_on", run.drawn_on}};
}

Json default_settings() {
  TrainSettings defaults;
  Json json = Json::object();
  for (const FieldValue& field : bind_fields(defaults, train_fields())) json[field.key] = field_text(field);
  return json;
}

const DrawnView* view_named(const ReportRun& run, const std::string& name) {
  for (const DrawnView& view : run.drawings.views)
    if (view.name == name) return &view;
  return nullptr;
}

// Returns one depth range for all runs, so that their depth images can be compared.
ValueRange common_depth_range(const ReportRuns& runs, const std::string& name) {
  std::optional<ValueRange> all;
  for (const ReportRun& run : runs) {
    const DrawnView* view = view_named(run, name);
    if (!view || view->depth.empty()) continue;
    const ValueRange own = central_depth_range(view->depth, view->alpha);
    all = all ? ValueRange{std::min(all->low, own.low), std::max(all->high, own.high)} : own;
  }
  return all.value_or(ValueRange{});
}

// Describes one view for all runs that have rendered it. If consecutive runs have the same ground truth, the
// page contains it only once.
Json view_json(const ReportRuns& runs, const std::string& name, PictureList& pictures) {
  const ValueRange range = common_depth_range(runs, name);
  Json json{{"name", name}, {"depth_range", {range.low, range.high}}, {"runs", Json::array()}};
  const Image8* shown = nullptr;
  std::size_t shown_number = 0;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const DrawnView* view = view_named(runs[r], name);
    if (!view) continue;
    const Image8& render = view->render;
    Json& of_run =
        json["runs"].emplace_back(Json{{"run", r}, {"width", render.width}, {"height", render.height}});
    if (view->time) json["time"] = *view->time;
    if (view->truth) {
      if (!shown || shown->rgb != view->truth->rgb) {
        shown = &*view->truth;
        shown_number = pictures.add(*shown, kLongestSide);
      }
      of_run["truth"] = shown_number;
    }
    of_run["render"] = pictures.add(render, kLongestSide);
    if (view->truth && view->truth->width == render.width && view->truth->height == render.height) {
      const double psnr = psnr_channel_mean(*view->truth, render);
      // The value is null if the PSNR is infinite because a channel is equal in both images.
      of_run["psnr"] = std::isfinite(psnr) ? Json(psnr) : Json();
      of_run["error"] = pictures.add(error_image(*view->truth, render, kErrorTop), kLongestSide);
    }
    if (view->depth.empty()) continue;
    of_run["depth"] =
        pictures.add(depth_image(view->depth, view->alpha, render.width, render.height, range), kLongestSide);
    of_run["alpha"] = pictures.add(grey_image(view->alpha, render.width, render.height), kLongestSide);
  }
  return json;
}

Json views_json(const ReportRuns& runs, PictureList& pictures) {
  std::vector<std::string> names;
  for (const ReportRun& run : runs)
    for (const DrawnView& view : run.drawings.views)
      if (std::ranges::find(names, view.name) == names.end()) names.push_back(view.name);
  Json json = Json::array();
  for (const std::string& name : names) json.push_back(view_json(runs, name, pictures));
  return json;
}

// Describes the decompositions of the model of each run by betas: the whole model first, then its parts.
Json decompositions_json(const ReportRuns& runs, PictureList& pictures) {
  Json json = Json::array();
  for (std::size_t r = 0; r < runs.size(); ++r)
    for (const Decomposition& d : runs[r].drawings.decompositions) {
      Json parts = Json::array();
      if (const DrawnView* whole = view_named(runs[r], runs[r].drawings.apart_view))
        parts.push_back({{"name", "all splats"}, {"picture", pictures.add(whole->render, kLongestPart)}});
      for (const DrawnPart& part : d.parts)
        parts.push_back({{"name", part.name},
                         {"low", part.range.low},
                         {"high", part.range.high},
                         {"splats", part.splats},
                         {"picture", pictures.add(part.image, kLongestPart)}});
      json.push_back({{"run", r},
                      {"view", runs[r].drawings.apart_view},
                      {"kind", to_string(d.kind)},
                      {"meaningful", d.meaningful},
                      {"width", d.parts.front().image.width},
                      {"height", d.parts.front().image.height},
                      {"parts", parts}});
    }
  return json;
}

Json times_json(const ReportRuns& runs, PictureList& pictures) {
  Json json = Json::array();
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const std::vector<DrawnTime>& times = runs[r].drawings.times;
    if (times.empty()) continue;
    Json strip = Json::array();
    for (const DrawnTime& at : times)
      strip.push_back({{"time", at.time}, {"picture", pictures.add(at.image, kLongestTime)}});
    json.push_back({{"run", r},
                    {"width", times.front().image.width},
                    {"height", times.front().image.height},
                    {"pictures", strip}});
  }
  return json;
}

// Makes one histogram for each quantity that a run has, with the same bins for all runs.
Json histograms_json(const ReportRuns& runs) {
  std::vector<std::vector<SplatQuantity>> all(runs.size());
  std::vector<const SplatQuantity*> first;  // for each name, the quantity of the first run that has it
  const auto named = [](const std::string& name) {
    return [&name](const SplatQuantity& q) { return q.name == name; };
  };
  for (std::size_t r = 0; r < runs.size(); ++r) {
    if (runs[r].model) all[r] = splat_quantities(*runs[r].model);
    for (const SplatQuantity& q : all[r])
      if (std::ranges::none_of(first, [&](const SplatQuantity* f) { return f->name == q.name; }))
        first.push_back(&q);
  }
  Json json = Json::array();
  for (const SplatQuantity* quantity : first) {
    std::vector<double> together;
    for (const auto& own : all)
      if (const auto q = std::ranges::find_if(own, named(quantity->name)); q != own.end())
        together.insert(together.end(), q->values.begin(), q->values.end());
    const Bins bins = quantity->unit_interval
                          ? make_bins(0.0, 1.0, kBins)
                          : make_bins(std::move(together), kBins, quantity->logarithmic, kOutside);
    Json of_runs = Json::array();
    for (std::size_t r = 0; r < runs.size(); ++r) {
      const auto q = std::ranges::find_if(all[r], named(quantity->name));
      if (q == all[r].end()) continue;
      const Histogram h = make_histogram(q->values, bins);
      of_runs.push_back({{"run", r},
                         {"share", h.share},
                         {"values", h.values},
                         {"outside", h.below + h.above},
                         {"minimum", h.minimum},
                         {"median", h.median},
                         {"maximum", h.maximum}});
    }
    json.push_back({{"name", quantity->name},
                    {"unit", quantity->unit},
                    {"meaning", quantity->meaning},
                    {"logarithmic", quantity->logarithmic},
                    {"edges", bins.edges},
                    {"runs", of_runs}});
  }
  return json;
}

std::string document(const Json& record, const Json& pictures, const ReportViewer& viewer) {
  std::vector<PageCode> styles{report_style()}, scripts{report_script()};
  if (!viewer.markup.empty()) {
    styles.push_back(viewer.style);
    scripts.push_back(viewer.script);
  }
  std::string body = viewer.markup;
  for (const auto& [id, json] : {std::pair{"ubs-record", &record}, {"ubs-pictures", &pictures}})
    body += fmt::format("<script id=\"{}\" type=\"application/json\">{}</script>\n", id, script_json(*json));
  for (const PageCode& code : scripts) body += fmt::format("<script>{}</script>\n", code.text);
  return page_shell(record["title"].get<std::string>(), styles, scripts,
                    viewer.markup.empty() ? "img-src data:" : viewer.policy, body);
}

}  // namespace

ReportPage make_report(const ReportRuns& runs, const std::string& made_by, const ReportViewer& viewer) {
  if (runs.empty()) fail(ErrorKind::internal, "a report needs at least one run");
  PictureList pictures;
  std::string title;
  Json list = Json::array();
  for (const ReportRun& run : runs) {
    title += (title.empty() ? "" : " / ") + run.record.name;
    list.push_back(run_json(run));
  }
  ReportPage page;
  page.record = {{"title", title},
                 {"made_by", made_by},
                 {"runs", list},
                 {"defaults", default_settings()},
                 {"error_top", kErrorTop},
                 {"views", views_json(runs, pictures)},
                 {"decompositions", decompositions_json(runs, pictures)},
                 {"times", times_json(runs, pictures)},
                 {"histograms", histograms_json(runs)}};
  if (!viewer.markup.empty()) page.record["viewer"] = {{"run", viewer.run}, {"psnr", viewer.psnr}};
  page.html = document(page.record, pictures.uris(), viewer);
  page.pictures = pictures.uris().size();
  for (const Json& uri : pictures.uris()) page.picture_bytes += uri.get_ref<const std::string&>().size();
  return page;
}

}  // namespace ubs
