// SPDX-License-Identifier: Apache-2.0
// make_report() makes the page of `ubs report`: one self-contained HTML document about one run, or about
// several side by side. C++ gathers a record as JSON and the pictures. page.css, page.js and Chart.js, which
// are embedded, draw tables and charts from them in the browser.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "host/look/report/html.hpp"
#include "host/look/report/run_drawings.hpp"
#include "host/look/report/run_record.hpp"

namespace ubs {

struct ReportRun {
  RunRecord record;                 // its remarks are shown, with those of reading and drawing
  std::optional<MixedModel> model;  // nothing: no pictures of it, no histograms
  RunDrawings drawings;
  std::string views_from;  // in words: "3 of the 200 views of split 'test' of ../data/lego"
  std::string drawn_on;    // device of the pictures; "" when none were drawn
};

struct ReportPage {
  std::string html;
  // What the page shows (docs/report.md). Pictures are numbers in a list of data URIs, which only the page
  // has.
  Json record;
  std::size_t pictures = 0, picture_bytes = 0;  // of their data URIs
};

// A part of the page that shows the model live (host/look/web), and what the page's policy must allow for it.
struct ReportViewer {
  std::string markup;  // nothing: no viewer
  PageCode style, script;
  std::string policy;  // directives for its images and its worker
};

// Returns the page about `runs`, at least one. `made_by` is the version line of the program, for the foot of
// the page.
ReportPage make_report(const std::vector<ReportRun>& runs, const std::string& made_by,
                       const ReportViewer& viewer = {});

PageCode report_style();
PageCode report_script();

}  // namespace ubs
