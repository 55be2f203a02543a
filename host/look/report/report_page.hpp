// SPDX-License-Identifier: Apache-2.0
// make_report() makes the page of `ubs report`: one self-contained HTML document about one run, or about
// several runs side by side. The C++ code collects the data as JSON, and encodes the images. In the browser,
// the embedded files page.css, page.js and Chart.js show both as tables, charts and images.
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
  // The page shows the remarks of the record. They include remarks from reading the run and from rendering.
  RunRecord record;
  std::optional<MixedModel> model;  // if it is missing, the page has no histograms
  RunDrawings drawings;
  // Text that describes the views, such as "3 of the 200 views of split 'test' of ../data/lego".
  std::string views_from;
  std::string drawn_on;  // device that rendered the images; "" if none were rendered
};

struct ReportPage {
  std::string html;
  // The data that the page shows (docs/report.md). Each image is given as the index of an entry in a list of
  // data URIs. Only the page contains this list.
  Json record;
  std::size_t pictures = 0, picture_bytes = 0;  // number of images, and bytes of their data URIs
};

// ReportViewer is the part of the page that shows the model interactively (host/look/web), with the
// directives that it needs in the content security policy of the page.
struct ReportViewer {
  std::string markup;  // empty: no viewer
  PageCode style, script;
  std::string policy;   // directives for its images and its worker
  std::size_t run = 0;  // index of the run whose model the viewer shows
  double psnr = 0;      // PSNR of the compressed model of the viewer against the original model [dB]
};

// Returns the page about `runs`. There must be at least one run. `made_by` is the version line of the
// program, for the page footer.
ReportPage make_report(const std::vector<ReportRun>& runs, const std::string& made_by,
                       const ReportViewer& viewer = {});

// These functions return the embedded files page.css, and Chart.js with page.js.
PageCode report_style();
PageCode report_script();

}  // namespace ubs
