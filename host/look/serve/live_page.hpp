// SPDX-License-Identifier: Apache-2.0
// The page that visitors are given. Style and camera are those of `ubs web`; what moves is live.js.
#pragma once

#include <string>

#include "host/look/report/html.hpp"
#include "host/look/serve/live.hpp"

namespace ubs::serve {

std::string page_markup();
PageCode page_script();
std::string live_page(const Scene& scene, bool training);

}  // namespace ubs::serve
