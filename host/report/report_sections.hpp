// SPDX-License-Identifier: Apache-2.0
// Sections of the page of `ubs report`, each for one run or several; empty where there is nothing to show.
// Runs keep their colour (c0, c1, ...) and their order in all of them.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "host/report/html.hpp"
#include "host/report/report_page.hpp"

namespace ubs {

using ReportRuns = std::vector<ReportRun>;

struct Section {
  std::string id, title;
  Html content;
};

// Pictures of a page, counted.
class PictureBook {
 public:
  // `longest`: of a side, in pixels of the page's picture. Says in its title where it was reduced.
  Html picture(const Image8& image, const std::string& alt, int longest);
  std::size_t count() const { return count_; }
  std::size_t bytes() const { return bytes_; }

 private:
  std::size_t count_ = 0, bytes_ = 0;
};

Section summary_section(const ReportRuns& runs);
Section curves_section(const ReportRuns& runs);
Section views_section(const ReportRuns& runs, PictureBook& book);
Section decomposition_section(const ReportRuns& runs, PictureBook& book);
Section times_section(const ReportRuns& runs, PictureBook& book);
Section parameters_section(const ReportRuns& runs);
Section measurements_section(const ReportRuns& runs);
Section settings_section(const ReportRuns& runs);
Section device_section(const ReportRuns& runs);

// What the run measured of a test view; empty where it did not.
Html view_facts(const RunRecord& run, const std::string& view);

std::string run_colour(std::size_t run);                  // class of the style
Html run_label(const ReportRuns& runs, std::size_t run);  // name with its colour
// Of tables with a column a run.
inline constexpr const char* kNothing = "\xe2\x80\x93";  // where a run does not know
inline TableCell plain(std::string_view content) { return {text(content)}; }
TableRow head_row(const ReportRuns& runs, std::string_view first);
// What metrics.json has at a path, as text.
TableRow text_row(const ReportRuns& runs, const std::string& name, const std::vector<std::string>& path);
Html paragraph(std::string_view style, const Html& content);

PageCode report_style();
PageCode report_script();

}  // namespace ubs
