// SPDX-License-Identifier: Apache-2.0
// The page of `ubs report`: one self-contained HTML document about one run, or several side by side. Nothing
// is fetched when it is opened; it can be read without JavaScript, which only zooms.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "host/report/html.hpp"
#include "host/report/run_drawings.hpp"
#include "host/report/run_record.hpp"

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
  std::size_t pictures = 0, picture_bytes = 0;  // of their data URIs
};

// A part of the page that shows the model live (host/web), and what the page's policy must allow for it.
struct ReportViewer {
  std::string markup;  // nothing: no viewer
  PageCode style, script;
  std::string policy;  // directives for its images and its worker
};

// At least one run. `made_by`: version line of the program, for the foot of the page.
ReportPage make_report(const std::vector<ReportRun>& runs, const std::string& made_by,
                       const ReportViewer& viewer = {});

}  // namespace ubs
