// SPDX-License-Identifier: Apache-2.0
// A model as a page that shows it: one HTML document with the container (host/data/ubsz.hpp) and the viewer,
// which fetches nothing. The same viewer as a part of other pages.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "host/api/scene_frame.hpp"
#include "host/base/json.hpp"
#include "host/look/report/html.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs::web {

inline constexpr std::size_t kMaxCameras = 100;  // that a page offers

struct ViewerPage {
  std::string title;
  SceneFrame scene;
  std::vector<View> cameras;  // to jump to; at least one, images are not looked at
  std::size_t start = 0;      // among them
  bool embed = false;         // in a frame of another page: controls are folded, the wheel waits for a click
  std::vector<std::size_t>
      parts;           // where those of the model end that are shown one after the other; none: one
  std::string poster;  // URI of a still picture that is shown until the first frame; may be empty
};

// What each page of a scene is told of it: its frame, and the cameras to jump to.
Json page_scene(const SceneFrame& frame, std::span<const View> cameras);

PageCode viewer_style();
PageCode viewer_script();
PageCode part_script();  // tells the viewer of a further part of the model
std::string worker_script();

// The element and its data, for a body that ends with viewer_script(); the model in one part. `section`: as a
// part of a page.
std::string viewer_markup(const ViewerPage& page, const TrainSettings& drawn,
                          std::span<const std::byte> model, bool section);
// What the content security policy of a page with a viewer says beside the hashes of style and script.
inline constexpr const char* kViewerPolicy = "img-src data:; worker-src blob:";
std::string web_page(const ViewerPage& page, const TrainSettings& drawn, std::span<const std::byte> model);

}  // namespace ubs::web
