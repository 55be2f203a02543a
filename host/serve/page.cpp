// SPDX-License-Identifier: Apache-2.0
#include "host/serve/page.hpp"

#include "host/web/page.hpp"

namespace ubs::serve {
namespace {

std::string page_options(const Scene& scene, bool training) {
  Json options = web::page_scene(scene.frame, scene.cameras);
  options.update({{"training", training}, {"timed", scene.has_time}});
  return web::script_json(options);
}

}  // namespace

std::string live_page(const Scene& scene, bool training) {
  const PageCode style = web::viewer_style(), script = page_script();
  const std::string policy = fmt::format(
      "default-src 'none'; style-src {}; script-src {}; connect-src 'self'; img-src data:; base-uri 'none'; "
      "form-action 'none'",
      policy_hash(style), policy_hash(script));
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"{}\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>{}</title>\n<style>{}</style>\n</head>\n<body>\n"
      "<noscript>This page needs JavaScript.</noscript>\n{}"
      "<script id=\"ubs-options\" type=\"application/json\">{}</script>\n<script>{}</script>\n"
      "</body>\n</html>\n",
      policy, escape_html(scene.title), style.text, page_markup(), page_options(scene, training),
      script.text);
}

}  // namespace ubs::serve
