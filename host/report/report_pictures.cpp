// SPDX-License-Identifier: Apache-2.0
// Pictures of the page of `ubs report`: sets of panes that zoom together (page.js).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/report/page_picture.hpp"
#include "host/report/report_sections.hpp"

namespace ubs {
namespace {

constexpr int kLongestSide = 1000, kLongestPart = 640, kLongestTime = 320;
constexpr double kErrorTop = 0.25;  // of the colours of errors; 1 is black for white

Html pane(const Html& picture, const Html& caption) {
  return tag("figure", tag("div", {{"class", "pane"}}, picture) + tag("figcaption", caption)) + raw("\n");
}
Html pane(PictureBook& book, const Image8& image, const std::string& alt, int longest, const Html& caption) {
  return pane(book.picture(image, alt, longest), caption);
}

Html zoom_set(int columns, int width, const Html& panes) {
  return tag("div", {{"class", fmt::format("zoom n{}", columns)}, {"data-width", std::to_string(width)}},
             panes) +
         paragraph("readout", text("\xc2\xa0"));
}

const DrawnView* view_named(const ReportRun& run, const std::string& name) {
  for (const DrawnView& view : run.drawings.views)
    if (view.name == name) return &view;
  return nullptr;
}

std::vector<std::string> view_names(const ReportRuns& runs) {
  std::vector<std::string> names;
  for (const ReportRun& run : runs)
    for (const DrawnView& view : run.drawings.views)
      if (std::find(names.begin(), names.end(), view.name) == names.end()) names.push_back(view.name);
  return names;
}

// One range for all runs, so that their depths can be compared.
ValueRange common_depth_range(const ReportRuns& runs, const std::string& name) {
  ValueRange all;
  bool first = true;
  for (const ReportRun& run : runs) {
    const DrawnView* view = view_named(run, name);
    if (!view || view->depth.empty()) continue;
    const ValueRange own = depth_range(view->depth, view->alpha);
    all = first ? own : ValueRange{std::min(all.low, own.low), std::max(all.high, own.high)};
    first = false;
  }
  return all;
}

bool comparable(const DrawnView& view) {
  return view.truth && view.truth->width == view.render.width && view.truth->height == view.render.height;
}

std::string psnr_text(const DrawnView& view) {
  const double psnr = psnr_channel_mean(*view.truth, view.render);
  return std::isfinite(psnr) ? fmt::format("{:.2f} dB", psnr) : "exact";
}

// Panes of one run, of a view: truth (unless it was shown), render, error, depth, alpha.
Html view_panes(PictureBook& book, const ReportRuns& runs, std::size_t r, const DrawnView& view,
                const ValueRange& range, const DrawnView* shown_before) {
  const Html label = runs.size() > 1 ? run_label(runs, r) + raw(" ") : Html{};
  Html out;
  const bool again = shown_before && view.truth && shown_before->truth->rgb == view.truth->rgb;
  if (view.truth && !again)
    out += pane(book, *view.truth, "ground truth", kLongestSide, text("ground truth"));
  else
    out += tag("figure", {{"class", "blank"}},
               tag("figcaption", text(again ? "ground truth as above" : "no ground truth")));
  out += pane(book, view.render, "render", kLongestSide,
              label + text(comparable(view) ? "render, " + psnr_text(view) : "render"));
  if (comparable(view))
    out += pane(book, error_image(*view.truth, view.render, kErrorTop), "error", kLongestSide,
                label + text("error"));
  if (view.depth.empty()) return out;
  const int w = view.render.width, h = view.render.height;
  out += pane(book, depth_image(view.depth, view.alpha, w, h, range), "depth", kLongestSide,
              label + text(fmt::format("depth {:.3g} to {:.3g}", range.low, range.high)));
  return out + pane(book, grey_image(view.alpha, w, h), "alpha", kLongestSide, label + text("alpha"));
}

std::string view_title(const std::string& name, const ReportRuns& runs) {
  for (const ReportRun& run : runs)
    if (const DrawnView* view = view_named(run, name); view && view->time)
      return fmt::format("{} at time {:.3g}", name, *view->time);
  return name;
}

Html view_block(PictureBook& book, const ReportRuns& runs, const std::string& name) {
  const ValueRange range = common_depth_range(runs, name);
  Html panes;
  const DrawnView* shown = nullptr;
  int width = 0;
  std::size_t most = 0;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const DrawnView* view = view_named(runs[r], name);
    if (!view) continue;
    panes += view_panes(book, runs, r, *view, range, shown);
    if (view->truth && !shown) shown = view;
    width = std::max(width, view->render.width);
    most = std::max<std::size_t>(most, 2 + (comparable(*view) ? 1 : 0) + (view->depth.empty() ? 0 : 2));
  }
  if (runs.size() == 1) panes += view_facts(runs[0].record, name);
  const int columns = runs.size() > 1 ? static_cast<int>(most) : 3;
  return tag("h3", text(view_title(name, runs))) + zoom_set(columns, width, panes);
}

Html views_note(const ReportRuns& runs, PictureBook& book) {
  Html sources;
  for (std::size_t r = 0; r < runs.size(); ++r)
    if (!runs[r].views_from.empty())
      sources +=
          tag("li", (runs.size() > 1 ? run_label(runs, r) + raw(" ") : Html{}) + text(runs[r].views_from));
  const auto strip = [&](const Image8& legend, const std::string& low, const std::string& high) {
    return tag("span", {{"class", "strip"}}, text(low) + book.picture(legend, "colours", 1000) + text(high));
  };
  return tag("ul", {{"class", "sources"}}, sources) +
         paragraph("note", text("Wheel zooms all panes together, dragging moves, double click resets. ") +
                               strip(error_legend(), "error 0",
                                     fmt::format("{} (mean of |difference|, colours 0 to 1)", kErrorTop)) +
                               raw(" ") + strip(depth_legend(), "depth near", "far"));
}

std::string quantile_text(const BetaRange& range) {
  return fmt::format("{:.0f} to {:.0f} %", 100 * range.low, 100 * range.high);
}

std::string kind_text(BetaKind kind) {
  switch (kind) {
    case BetaKind::spatial:
      return "spatial beta: low is smooth surface, high is fine texture";
    case BetaKind::angular:
      return "angular betas: low is diffuse, high depends on the view";
    case BetaKind::temporal:
      return "temporal beta: low stands still, high moves";
  }
  return "";
}

Html decomposition_block(PictureBook& book, const ReportRun& run, const Decomposition& d) {
  Html panes;
  int width = 1;
  for (const DrawnPart& part : d.parts) {
    panes += pane(book, part.image, part.name, kLongestPart,
                  text(fmt::format("{} ({}): {} splats", part.name, quantile_text(part.range), part.splats)));
    width = part.image.width;
  }
  if (const DrawnView* whole = view_named(run, run.drawings.apart_view))
    panes = pane(book, whole->render, "all splats", kLongestPart, text("all splats")) + panes;
  Html out = tag("h4", text(kind_text(d.kind)));
  if (!d.meaningful)
    out += paragraph("warn",
                     text("All betas are equal: the parts follow the order of the file and mean nothing."));
  return out + zoom_set(4, width, panes);
}

}  // namespace

Section views_section(const ReportRuns& runs, PictureBook& book) {
  Html blocks;
  for (const std::string& name : view_names(runs)) blocks += view_block(book, runs, name);
  if (blocks.empty()) return {"views", "Views", {}};
  return {"views", "Views", views_note(runs, book) + blocks};
}

Section decomposition_section(const ReportRuns& runs, PictureBook& book) {
  Html out;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const RunDrawings& drawings = runs[r].drawings;
    if (drawings.decompositions.empty()) continue;
    const Html view = text("view " + drawings.apart_view);
    out += tag("h3", runs.size() > 1 ? run_label(runs, r) + raw(" ") + view : view);
    for (const Decomposition& d : drawings.decompositions) out += decomposition_block(book, runs[r], d);
  }
  if (out.empty()) return {"decomposition", "Decomposition", {}};
  return {"decomposition", "Decomposition",
          paragraph("note", text("The splats of a range of quantiles of their betas, drawn alone.")) + out};
}

Section times_section(const ReportRuns& runs, PictureBook& book) {
  Html out;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const RunDrawings& drawings = runs[r].drawings;
    if (drawings.times.empty()) continue;
    Html panes;
    for (const DrawnTime& at : drawings.times)
      panes += pane(book, at.image, "render", kLongestTime, text(fmt::format("time {:.2f}", at.time)));
    if (runs.size() > 1) out += tag("h3", run_label(runs, r));
    out += zoom_set(6, drawings.times.front().image.width, panes);
  }
  if (out.empty()) return {"times", "Over time", {}};
  return {"times", "Over time",
          paragraph("note", text("The camera of the first view held still while time passes from 0 to 1.")) +
              out};
}

}  // namespace ubs
