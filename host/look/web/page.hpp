// SPDX-License-Identifier: Apache-2.0
// web_page() makes a page that shows a model: one HTML document with the model data (host/formats/ubsz.hpp)
// and the viewer. The page loads no other files. viewer_markup() makes the same viewer as a part of another
// page.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "host/base/json.hpp"
#include "host/look/report/html.hpp"
#include "host/model/scene_frame.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {
struct TrainSettings;
}

namespace ubs::web {

inline constexpr std::size_t kMaxCameras = 100;  // maximum number of cameras in a page

struct ViewerPage {
  std::string title;
  SceneFrame scene;
  std::vector<View> cameras;  // selectable cameras, at least one; images are not used
  std::size_t start = 0;      // index of the initial camera
  // True if these cameras captured the scene. Then the page marks views that none of them saw. False if the
  // cameras of the model are unknown, and `cameras` were placed around it.
  bool captured = false;
  // True if the page will be shown in a frame of another page. Then the controls are folded, and the wheel
  // zooms only after a click.
  bool embed = false;
  // End of each part of the model data [bytes]. The page shows the parts one after the other. Empty: the data
  // are one part.
  std::vector<std::size_t> parts;
  // URI of a still image that is shown until the first frame (poster_uri() in steps.hpp); may be empty.
  std::string poster;
};

// Returns the data that every page of a scene needs: its frame, and the selectable cameras. See ViewerPage.
Json page_scene(const SceneFrame& frame, std::span<const View> cameras, std::size_t start, bool captured);

// These functions return the embedded style sheet and scripts.
PageCode viewer_style();
PageCode viewer_script();
PageCode part_script();  // informs the viewer about a further part of the model
std::string worker_script();

// Returns the HTML element of the viewer and its data, with the model in one part. The page must contain
// viewer_script() after them. `drawn` are the settings that the model is rendered with. `section` is true if
// the viewer is a section of a longer page.
std::string viewer_markup(const ViewerPage& page, const TrainSettings& drawn,
                          std::span<const std::byte> model, bool section);
// Directives of the content security policy of a page with a viewer, besides the hashes of style and script.
inline constexpr const char* kViewerPolicy = "img-src data:; worker-src blob:";
// Returns the complete page of `ubs web`.
std::string web_page(const ViewerPage& page, const TrainSettings& drawn, std::span<const std::byte> model);

}  // namespace ubs::web
