// SPDX-License-Identifier: Apache-2.0
#include "tools/common/page_views.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "host/model/camera_path.hpp"

namespace ubs::tools {
namespace {

// Number of cameras around a model that lists no cameras.
constexpr int kCamerasAround = 12;

std::vector<Camera> cameras_around(const MixedModel& model, FrameHints hints) {
  const double fov = Pose{}.fov;
  const Canvas canvas;
  hints.fov = fov * canvas.height / canvas.width;  // images are wider than high
  const SceneFrame frame = scene_frame(model, {}, hints);
  const auto path = orbit_path(frame, fov, 1);
  std::vector<Camera> cameras;
  for (const double moment : path_moments(kCamerasAround, true))
    cameras.push_back(camera_at(path->at(moment), {.extra = frame.extra}));
  return cameras;
}

}  // namespace

Split page_views(const ModelOptions& options, const LoadedModel& loaded, const TrainSettings& settings,
                 const std::optional<OpenedData>& opened, const FrameHints& hints) {
  if (!options.data.empty())
    return open_split_for(loaded.offset, options.data, options.split, settings, Images::skip, opened);
  Split split{.name = "views", .views = {}};
  std::vector<Camera> cameras = noted_cameras(loaded.model, loaded.notes.cameras);
  if (cameras.empty()) cameras = cameras_around(loaded.model, hints);
  for (std::size_t i = 0; i < cameras.size(); ++i)
    split.views.push_back({.name = fmt::format("camera {}", i), .camera = cameras[i]});
  return split;
}

bool are_captured(const ModelOptions& options, const LoadedModel& loaded) {
  return !options.data.empty() || !loaded.notes.cameras.empty();
}

serve::Scene served_scene(const std::string& path, const MixedModel& model, const Split& views, bool captured,
                          const FrameHints& hints) {
  serve::Scene scene{.title = std::filesystem::path(path).filename().string(),
                     .frame = scene_frame(model, cameras_of(views), hints),
                     .captured = captured,
                     .has_time = model.has_time()};
  const std::size_t step = (views.views.size() + serve::kMaxCameras - 1) / serve::kMaxCameras;
  for (std::size_t i = 0; i < views.views.size(); i += step)
    scene.cameras.push_back({.name = views.views[i].name, .camera = views.views[i].camera});
  if (captured) scene.start = start_camera(model, cameras_of({.name = {}, .views = scene.cameras}));
  return scene;
}

}  // namespace ubs::tools
