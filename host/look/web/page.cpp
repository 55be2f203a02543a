// SPDX-License-Identifier: Apache-2.0
// See page.hpp.
#include "host/look/web/page.hpp"

#include <fmt/format.h>

#include "host/look/report/page_picture.hpp"
#include "host/scene/camera_json.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs::web {
namespace {

std::string options_text(const ViewerPage& page, const TrainSettings& drawn, bool section) {
  Json options = page_scene(page.scene, page.cameras, page.start, page.captured);
  options.update({{"title", page.title},
                  {"background", drawn.background.colour},
                  {"near", planes_of(drawn).near},
                  {"far", planes_of(drawn).far},
                  {"eps2d", drawn.eps2d},
                  {"alphaMin", drawn.alpha_min},
                  {"page", !section && !page.embed},
                  {"embed", page.embed},
                  {"poster", page.poster}});
  return script_json(options);
}

std::string data_script(std::string_view id, std::string_view type, std::string_view text) {
  return fmt::format("<script id=\"{}\" type=\"{}\">{}</script>\n", id, type, text);
}

std::string model_script(std::span<const std::byte> model, bool first = true) {
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(model.data()), model.size());
  return fmt::format("<script{} class=\"ubs-model\" type=\"application/octet-stream\">{}</script>\n",
                     first ? " id=\"ubs-model\"" : "", base64(bytes));
}

// Returns the markup of the viewer. `model` is the markup of the model data. It is empty if the page adds the
// model data after the script of the viewer.
std::string element_markup(const ViewerPage& page, const TrainSettings& drawn, bool section,
                           const std::string& model) {
  return fmt::format("<div id=\"ubs-viewer\" class=\"{}\"></div>\n", section ? "section" : "page") +
         data_script("ubs-options", "application/json", options_text(page, drawn, section)) + model +
         data_script("ubs-worker", "text/plain", worker_script());
}

}  // namespace

Json page_scene(const SceneFrame& frame, std::span<const View> cameras, std::size_t start, bool captured) {
  Json list = Json::array();
  for (const View& view : cameras) {
    Json& json = list.emplace_back(camera_json(view.camera));
    json["name"] = view.name;
    json["centre"] = view.camera.centre();
  }
  return {{"scene", {{"centre", frame.centre}, {"up", frame.up}, {"distance", frame.distance}}},
          {"cameras", list},
          {"start", start},
          {"captured", captured}};
}

std::string viewer_markup(const ViewerPage& page, const TrainSettings& drawn,
                          std::span<const std::byte> model, bool section) {
  return element_markup(page, drawn, section, model_script(model));
}

std::string web_page(const ViewerPage& page, const TrainSettings& drawn, std::span<const std::byte> model) {
  const PageCode script = viewer_script(), part = part_script();
  std::string body =
      element_markup(page, drawn, false, "") + fmt::format("<script>{}</script>\n", script.text);
  // The model data follow the viewer, which shows each part as soon as the browser has received it.
  std::size_t begin = 0;
  for (const std::size_t end : page.parts.empty() ? std::vector{model.size()} : page.parts) {
    body += model_script(model.subspan(begin, end - begin), begin == 0) +
            fmt::format("<script>{}</script>\n", part.text);
    begin = end;
  }
  return page_shell(page.title, {viewer_style()}, {script, part}, kViewerPolicy, body);
}

}  // namespace ubs::web
