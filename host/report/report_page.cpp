// SPDX-License-Identifier: Apache-2.0
// See report_page.hpp.
#include "host/report/report_page.hpp"

#include <fmt/format.h>

#include "host/base/error.hpp"
#include "host/report/page_picture.hpp"
#include "host/report/report_sections.hpp"

namespace ubs {
namespace {

std::string page_title(const ReportRuns& runs) {
  std::string title;
  for (const ReportRun& run : runs) title += (title.empty() ? "" : " / ") + run.record.name;
  return title;
}

Html remarks(const ReportRuns& runs) {
  Html items;
  for (std::size_t r = 0; r < runs.size(); ++r)
    for (const std::string& remark : runs[r].record.remarks)
      items += tag("li", (runs.size() > 1 ? run_label(runs, r) + raw(" ") : Html{}) + text(remark));
  return items.empty() ? Html{} : tag("ul", {{"class", "remarks"}}, items);
}

Html header(const ReportRuns& runs, const std::vector<Section>& sections) {
  Html links;
  for (const Section& s : sections)
    if (!s.content.empty()) links += tag("a", {{"href", "#" + s.id}}, text(s.title)) + raw("\n");
  const Html kind =
      paragraph("kicker", text(runs.size() == 1 ? "Training run" : "Comparison of training runs"));
  return tag("header", kind + tag("h1", text(page_title(runs))) + remarks(runs)) + tag("nav", links);
}

std::string document(const ReportRuns& runs, const std::vector<Section>& sections, const std::string& made_by,
                     const ReportViewer& viewer) {
  Html body = header(runs, sections);
  for (const Section& s : sections)
    if (!s.content.empty())
      body += raw("\n") + tag("section", {{"id", s.id}}, tag("h2", text(s.title)) + raw("\n") + s.content);
  body += tag("footer", text("Made by " + made_by + "."));
  std::vector<PageCode> styles{report_style()}, scripts{report_script()};
  if (!viewer.markup.empty()) {
    styles.push_back(viewer.style);
    scripts.push_back(viewer.script);
  }
  Html content = tag("main", body);
  for (const PageCode& code : scripts) content += tag("script", raw(code.text));
  return page_shell(page_title(runs), styles, scripts,
                    viewer.markup.empty() ? "img-src data:" : viewer.policy, content.markup);
}

}  // namespace

Html PictureBook::picture(const Image8& image, const std::string& alt, int longest) {
  const PagePicture p = page_picture(image, longest);
  ++count_;
  bytes_ += p.bytes;
  Attributes attributes{
      {"src", p.uri}, {"alt", alt}, {"width", std::to_string(p.width)}, {"height", std::to_string(p.height)}};
  if (p.reduced > 1)
    attributes.emplace_back("title", fmt::format("{} x {} pixels, shown reduced by {:.3g}", image.width,
                                                 image.height, p.reduced));
  return void_tag("img", attributes);
}

std::string run_colour(std::size_t run) { return fmt::format("c{}", run % 7); }

Html run_label(const ReportRuns& runs, std::size_t run) {
  return tag("span", {{"class", "run " + run_colour(run)}}, text(runs[run].record.name));
}

TableRow head_row(const ReportRuns& runs, std::string_view first) {
  TableRow head{plain(first)};
  for (std::size_t r = 0; r < runs.size(); ++r) head.push_back({run_label(runs, r)});
  return head;
}

Html paragraph(std::string_view style, const Html& content) {
  return tag("p", {{"class", std::string(style)}}, content) + raw("\n");
}

ReportPage make_report(const ReportRuns& runs, const std::string& made_by, const ReportViewer& viewer) {
  if (runs.empty()) fail(ErrorKind::internal, "a report of no run");
  PictureBook book;
  const std::vector<Section> sections{{"viewer", "The model", raw(viewer.markup)},
                                      summary_section(runs),
                                      curves_section(runs),
                                      views_section(runs, book),
                                      decomposition_section(runs, book),
                                      times_section(runs, book),
                                      parameters_section(runs),
                                      measurements_section(runs),
                                      settings_section(runs),
                                      device_section(runs)};
  ReportPage page;
  page.html = document(runs, sections, made_by, viewer);
  page.pictures = book.count();
  page.picture_bytes = book.bytes();
  return page;
}

}  // namespace ubs
