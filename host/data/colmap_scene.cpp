// SPDX-License-Identifier: Apache-2.0
// A COLMAP folder as a data set: sparse model + folder of images (+ masks), split by name.

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/data/colmap.hpp"
#include "host/data/data_root.hpp"
#include "host/data/load_dataset.hpp"
#include "host/data/view_image.hpp"
#include "host/data/view_names.hpp"
#include "host/scene/pose.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

void set_pose(Camera& camera, const ColmapImage& image) {
  const auto [w, x, y, z] = image.rotation;
  camera.rotation = matrix({w, x, y, z});
  camera.translation = image.translation;
}

// COLMAP looks for "<image name>.png" below the folder of masks; others keep the name, or change its
// extension. A name that leads out of the folder would make the image its own mask.
fs::path mask_of(const fs::path& folder, const std::string& name) {
  const std::string plain = fs::path(name).lexically_normal().string();
  if (plain.starts_with('/') || plain.starts_with("../")) return {};
  const fs::path kept = folder / "masks" / name;
  for (const fs::path& candidate :
       {fs::path(kept).concat(".png"), kept, fs::path(kept).replace_extension(".png")})
    if (path_exists(candidate)) return candidate;
  return {};
}

void describe_cameras(const ColmapModel& model, LoadReport& report) {
  std::map<std::string, int> counts;
  for (const auto& [id, camera] : model.cameras) ++counts[camera.model];
  for (const auto& [name, count] : counts) report.note(fmt::format("{} {} camera(s)", count, name));
}

}  // namespace

LoadedScene load_colmap(const fs::path& folder, const DatasetOptions& options) {
  const fs::path model_folder = find_colmap_model(folder);
  if (model_folder.empty()) refuse_further_models(folder);
  if (model_folder.empty()) fail(ErrorKind::data, "{}: no sparse/0/cameras.bin or .txt", folder.string());
  DataRoot root(folder, options.read.allow_outside);
  for (const char* name : {"cameras", "images", "points3D"})
    for (const char* extension : {".bin", ".txt"}) root.check((model_folder / name).concat(extension));
  ColmapModel model = read_colmap_model(model_folder);
  if (model.images.empty()) fail(ErrorKind::data, "{}: the model has no images", model_folder.string());

  LoadedScene scene;
  describe_cameras(model, scene.report);
  // Beside the model when there is no such folder, as `ubs cameras` leaves photographs where they are.
  const bool beside = !is_folder(folder / "images") && path_exists(folder / model.images.front().name);
  const std::string image_folder = options.read.images != "auto" ? options.read.images
                                   : beside                      ? "."
                                                                 : "images";
  const bool have_folder = is_folder(folder / image_folder);
  if (options.load_images && !have_folder)
    fail(ErrorKind::data, "{}: there is no folder of images '{}'", folder.string(), image_folder);

  if (options.read.images != "auto") root.add(folder / image_folder);  // the user's word

  std::vector<View> views;
  std::size_t masks = 0;
  for (const ColmapImage& image : model.images) {
    View view;
    view.name = view_name(image.name);
    set_pose(view.camera, image);
    const std::string where = fmt::format("{}: image '{}'", model_folder.string(), image.name);
    const fs::path file = root.check(folder / image_folder / image.name, where);
    const fs::path mask = root.check(mask_of(folder, image.name), where);
    masks += !mask.empty();
    const bool found =
        attach_image(view, model.cameras.at(image.camera).lens, file, mask, options, scene.report);
    check_camera(view.camera, where);
    if (!found && have_folder) {
      scene.report.skip(image.name, "no such file in " + image_folder);
      continue;
    }
    views.push_back(std::move(view));
  }
  if (views.empty())
    fail(ErrorKind::data, "{}: none of the {} images of the model is in {}", folder.string(),
         model.images.size(), (folder / image_folder).string());
  if (masks > 0) scene.report.note(fmt::format("{} masks: masked pixels do not count", masks));
  settle_view_names(views);
  scene.splits = split_every(std::move(views), options.read.test_every);
  if (!model.points.positions.empty()) scene.points = std::move(model.points);
  return scene;
}

}  // namespace ubs
