// SPDX-License-Identifier: Apache-2.0
// load_colmap() loads a COLMAP folder as a data set. The folder contains a sparse model, images and optional
// masks. The views are divided into train and test views: by name, or, if there are few images, by the
// positions of their cameras (split_views.hpp).

#include <fmt/format.h>

#include <map>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/colmap.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/split_views.hpp"
#include "host/dataset/stated_views.hpp"
#include "host/scene/pose.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

void set_pose(Camera& camera, const ColmapImage& image) {
  const auto [w, x, y, z] = image.rotation;
  camera.rotation = matrix({w, x, y, z});
  camera.translation = image.translation;
}

void describe_cameras(const ColmapModel& model, LoadReport& report) {
  std::map<std::string, int> counts;
  for (const auto& [id, camera] : model.cameras) ++counts[camera.model];
  for (const auto& [name, count] : counts) report.note(fmt::format("{} {} camera(s)", count, name));
}

}  // namespace

LoadedScene load_colmap(const fs::path& folder, const DatasetOptions& options) {
  LoadedScene scene;
  const fs::path model_folder = find_colmap_model(folder, options.read.colmap_model, &scene.report);
  if (model_folder.empty())
    fail(ErrorKind::data, "{}: contains neither sparse/0/cameras.bin nor sparse/0/cameras.txt",
         folder.string());
  DataRoot root(folder, options.read.allow_outside);
  for (const char* name : {"cameras", "images", "points3D"})
    for (const char* extension : {".bin", ".txt"}) root.check((model_folder / name).concat(extension));
  ColmapModel model = read_colmap_model(model_folder);
  for (const std::string& name : model.unplaced)
    scene.report.skip(name, "its pose or camera in the model is not finite");
  for (const std::uint32_t id : model.unusable)
    scene.report.skip(fmt::format("camera {}", id), "its parameters in the model are not finite");
  for (const auto& [id, error] : model.refused)
    scene.report.skip(fmt::format("camera {}", id), "no image has this camera, and it is not valid");
  if (model.images.empty() && !model.unplaced.empty())
    fail(ErrorKind::data, "{}: the poses or cameras of all {} images are not finite", model_folder.string(),
         model.unplaced.size());
  if (model.images.empty()) fail(ErrorKind::data, "{}: the model has no images", model_folder.string());
  if (model.scaled_colours)
    scene.report.note_difference("the colours of points3D.txt are from 0 to 1, and are scaled to 0 to 255");

  describe_cameras(model, scene.report);
  std::vector<StatedView> stated;
  for (const ColmapImage& image : model.images) {
    const Lens& lens = model.cameras.at(image.camera).lens;
    StatedView& view = stated.emplace_back();
    view.image = {image.name, fmt::format("{}: image '{}'", model_folder.string(), image.name)};
    set_pose(view.pose, image);
    view.size = ImageSize{lens.width, lens.height};
    view.lens = [&lens](ImageSize) { return lens; };
  }
  // Names may be relative to the data folder itself and not to its folder `images`. `ubs cameras` writes such
  // names because it does not move the photographs, and so do runs that refine their cameras.
  const std::string& first = model.images.front().name;
  const bool beside = !path_exists(folder / "images" / first) && path_exists(folder / first);
  const ImageFolder images = find_image_folder(folder, options, root, first, {beside ? "." : "images"});
  // In the original LLFF folders, the reduced images have other names than the images of the model.
  std::vector<View> views = make_stated_views(
      folder, images, stated, root, options, scene.report,
      path_exists(folder / "poses_bounds.npy") ? ", or use the cameras in poses_bounds.npy with --layout llff"
                                               : "");
  // Folders in the LLFF layout contain poses_bounds.npy in addition to COLMAP's model. Published results on
  // these scenes use every 8th image as a test view, also for scenes with few images, so split_views(), which
  // treats scenes with few images differently, is not used.
  scene.splits = path_exists(folder / "poses_bounds.npy")
                     ? split_every(std::move(views), options.read.test_every)
                     : split_views(std::move(views), options.read.test_every, scene.report);
  const fs::path ply = model_folder / "points3D.ply";  // some tools write this file instead of points3D.bin
  note_not_finite(model.points, scene.report);
  if (!model.points.positions.empty())
    scene.points = std::move(model.points);
  else if (path_exists(ply))
    take_points(root.check(ply), scene);
  return scene;
}

}  // namespace ubs
