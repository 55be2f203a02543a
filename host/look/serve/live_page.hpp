// SPDX-License-Identifier: Apache-2.0
// live_page() returns the page that shows live training or a model. The page has the same style sheet and
// camera as the pages of `ubs web`. Its script is live.js.
#pragma once

#include <string>

#include "host/look/report/html.hpp"
#include "host/look/serve/live.hpp"

namespace ubs::serve {

// These functions return the embedded files page.html, and camera.js, controls.js and live.js as one script.
std::string page_markup();
PageCode page_script();
// `training` is true for live training and false for a model. `poster` is the URI of a still image that the
// page shows until its first frame; it may be empty.
std::string live_page(const Scene& scene, bool training, const std::string& poster);

}  // namespace ubs::serve
