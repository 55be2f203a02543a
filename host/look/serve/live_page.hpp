// SPDX-License-Identifier: Apache-2.0
// live_page() makes the page for viewers. It shares style and camera with `ubs web`; its script is live.js.
#pragma once

#include <string>

#include "host/look/report/html.hpp"
#include "host/look/serve/live.hpp"

namespace ubs::serve {

std::string page_markup();
PageCode page_script();
std::string live_page(const Scene& scene, bool training);

}  // namespace ubs::serve
