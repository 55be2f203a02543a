// SPDX-License-Identifier: Apache-2.0
#include "host/look/serve/live_page.hpp"

#include "host/look/web/page.hpp"

namespace ubs::serve {
namespace {

std::string page_options(const Scene& scene, bool training, const std::string& poster) {
  Json options = web::page_scene(scene.frame, scene.cameras, scene.start, scene.captured);
  options.update({{"training", training}, {"timed", scene.has_time}, {"poster", poster}});
  return script_json(options);
}

}  // namespace

std::string live_page(const Scene& scene, bool training, const std::string& poster) {
  const PageCode script = page_script();
  return page_shell(scene.title, {web::viewer_style()}, {script}, "connect-src 'self'; img-src data:",
                    page_markup() + fmt::format("<script id=\"ubs-options\" type=\"application/json\">{}"
                                                "</script>\n<script>{}</script>\n",
                                                page_options(scene, training, poster), script.text));
}

}  // namespace ubs::serve
