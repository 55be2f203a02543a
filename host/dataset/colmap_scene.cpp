// SPDX-License-Identifier: Apache-2.0
// load_colmap() loads a COLMAP folder as a data set. The folder contains a sparse model, images and optional
// masks. The views are divided into train and test views: by name, or, if there are few images, by the
// positions of their cameras (split_views.hpp).

#include <fmt/ranges.h>

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/colmap.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/name_index.hpp"
#include "host/dataset/named_files.hpp"
#include "host/dataset/split_views.hpp"
#include "host/dataset/view_image.hpp"
#include "host/dataset/view_names.hpp"
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
  // Names may be relative to the data folder itself and not to its folder `images`. `ubs cameras` writes such
  // names because it does not move the photographs, and so do runs that refine their cameras.
  const std::string& first = model.images.front().name;
  const bool beside = !path_exists(folder / "images" / first) && path_exists(folder / first);
  const std::string image_folder = options.read.images != "auto" ? options.read.images
                                   : beside                      ? "."
                                                                 : "images";
  const fs::path base = folder / image_folder;
  const bool have_folder = is_folder(base);
  const bool stated_folder = options.read.images != "auto";
  if (options.load_images && !have_folder && stated_folder)
    fail(ErrorKind::data, "{}: the image folder '{}' does not exist", folder.string(), image_folder);
  if (stated_folder && options.images_from_user) root.add(base);

  std::vector<StatedName> names;
  for (const ColmapImage& image : model.images)
    names.push_back({image.name, fmt::format("{}: image '{}'", model_folder.string(), image.name)});
  NamedFiles files(root, folder);
  const std::vector<fs::path> found = files.find(base, names, NamedFiles::Kind::image, stated_folder);
  const bool some = std::ranges::any_of(found, [](const fs::path& file) { return !file.empty(); });
  // In the original LLFF folders, the reduced images have other names than the images of the model.
  if (!some && (options.load_images || have_folder))
    fail(ErrorKind::data,
         "{}: none of the {} images of the model exists: for example, {}; copy the images there, or pass "
         "their folder with --images{}",
         folder.string(), names.size(), files.missing(base, names[0].name),
         path_exists(folder / "poses_bounds.npy")
             ? ", or use the cameras in poses_bounds.npy with --layout llff"
             : "");
  const std::vector<fs::path> mask_files = files.find_masks(names);

  std::vector<View> views;
  std::vector<std::size_t> counts;  // number of views of each image
  std::size_t masks = 0;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const ColmapImage& image = model.images[i];
    if (found[i].empty() && some) {
      scene.report.skip(image.name,
                        fmt::format("no such file in {}, although listed by the COLMAP model", image_folder));
      continue;
    }
    View view;
    const bool exact = found[i].empty() || found[i] == (base / image.name).lexically_normal();
    view.name =
        view_name(exact ? image.name : fmt::format("{}", fmt::join(path_components(image.name), "/")));
    set_pose(view.camera, image);
    masks += !mask_files[i].empty();
    counts.push_back(append_views(views, view, model.cameras.at(image.camera).lens, found[i], mask_files[i],
                                  options, scene.report));
    for (std::size_t k = views.size() - counts.back(); k < views.size(); ++k)
      check_camera(views[k].camera, names[i].where);
  }
  files.report(scene.report);
  if (masks > 0) scene.report.note(fmt::format("{} masks: masked pixels are ignored", masks));
  settle_image_names(views, counts);
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
