// SPDX-License-Identifier: Apache-2.0
// See stated_views.hpp.
#include "host/dataset/stated_views.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <utility>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/name_index.hpp"
#include "host/dataset/split_views.hpp"
#include "host/dataset/view_image.hpp"
#include "host/dataset/view_names.hpp"

namespace ubs {

namespace fs = std::filesystem;

ImageFolder find_image_folder(const fs::path& folder, const DatasetOptions& options, DataRoot& root,
                              const std::string& first, const std::vector<std::string>& candidates) {
  if (options.read.images != "auto") {
    ImageFolder chosen{folder / options.read.images, options.read.images, true};
    if (options.load_images && !is_folder(chosen.path))
      fail(ErrorKind::data, "{}: the image folder '{}' does not exist", folder.string(), chosen.name);
    if (options.images_from_user) root.add(chosen.path);
    return chosen;
  }
  for (const std::string& name : candidates)
    if (path_exists(folder / name / first)) return {folder / name, name};
  for (const std::string& name : candidates)
    if (is_folder(folder / name)) return {folder / name, name};
  return {folder / candidates[0], candidates[0]};
}

std::vector<View> make_stated_views(const fs::path& folder, const ImageFolder& images,
                                    const std::vector<StatedView>& stated, const DataRoot& root,
                                    const DatasetOptions& options, LoadReport& report,
                                    std::string_view hint) {
  std::vector<StatedName> names;
  for (const StatedView& view : stated) names.push_back(view.image);
  NamedFiles files(root, folder);
  const std::vector<fs::path> found = files.find(images.path, names, NamedFiles::Kind::image, images.chosen);
  const bool some = std::ranges::any_of(found, [](const fs::path& file) { return !file.empty(); });
  if (!some && (options.load_images || is_folder(images.path)))
    fail(
        ErrorKind::data,
        "{}: none of the {} images of the model exists: for example, {}; copy the images there, or pass "
        "their folder with --images{}",
        folder.string(), names.size(), files.missing(images.path, names[0].name), hint);
  const std::vector<fs::path> mask_files = files.find_masks(names);
  std::vector<View> views;
  std::vector<std::size_t> counts;  // number of views of each image
  std::size_t masks = 0;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string& name = names[i].name;
    if (found[i].empty() && some) {
      report.skip(name, fmt::format("no such file in {}, although it has a camera", images.name));
      continue;
    }
    if (found[i].empty() && !stated[i].size)
      fail(ErrorKind::data, "{}: the image {}, and its size is not stated", names[i].where,
           files.missing(images.path, name));
    View view;
    const bool exact = found[i].empty() || found[i] == (images.path / name).lexically_normal();
    view.name = view_name(exact ? name : fmt::format("{}", fmt::join(path_components(name), "/")));
    view.camera.rotation = stated[i].pose.rotation;
    view.camera.translation = stated[i].pose.translation;
    masks += !mask_files[i].empty();
    const Lens lens = stated[i].lens(stated[i].size ? *stated[i].size : image_file_size(found[i]));
    check_lens(lens, names[i].where);
    counts.push_back(append_views(views, view, lens, found[i], mask_files[i], options, report));
    for (std::size_t k = views.size() - counts.back(); k < views.size(); ++k)
      check_camera(views[k].camera, names[i].where);
  }
  files.report(report);
  if (masks > 0) report.note(fmt::format("{} masks: masked pixels are ignored", masks));
  settle_image_names(views, counts);
  return views;
}

void add_stated_views(LoadedScene& scene, const fs::path& folder, const ImageFolder& images,
                      const std::vector<StatedView>& stated, const DataRoot& root,
                      const DatasetOptions& options) {
  scene.splits = split_views(make_stated_views(folder, images, stated, root, options, scene.report),
                             options.read.test_every, scene.report);
}

Camera pose_from_camera(std::array<double, 9> to_camera, std::array<double, 3> translation, CameraAxes axes,
                        const std::string& where) {
  if (axes == CameraAxes::y_up_z_backward) {
    for (std::size_t i = 3; i < 9; ++i) to_camera[i] = -to_camera[i];
    translation[1] = -translation[1], translation[2] = -translation[2];
  }
  settle_rotation(to_camera);
  check_rotation(to_camera, where);
  Camera camera;
  camera.rotation = to_camera;
  camera.translation = translation;
  return camera;
}

Camera pose_from_world(std::array<double, 9> to_world, const std::array<double, 3>& position, CameraAxes axes,
                       const std::string& where) {
  std::array<double, 9> to_camera{};
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) to_camera[3 * r + c] = to_world[3 * c + r];
  Camera camera = pose_from_camera(to_camera, {}, axes, where);
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c) camera.translation[r] -= camera.rotation[3 * r + c] * position[c];
  return camera;
}

Lens make_lens(std::string_view model, ImageSize size, double fx, double fy, double cx, double cy) {
  const auto row = std::ranges::find(lens_models(), model, &LensModel::name);
  if (row == lens_models().end()) fail(ErrorKind::internal, "there is no lens model {}", model);
  return {row->formula, fx, fy, cx, cy, size.width, size.height, {}};
}

double number_in(std::string_view text, const std::string& where) {
  return numbers_in(text, 1, where).front();
}

std::vector<double> numbers_in(std::string_view text, std::size_t count, const std::string& where) {
  constexpr std::string_view kBlanks = " \t\r\n";
  std::vector<double> numbers;
  std::string_view rest = text;
  for (;;) {
    rest.remove_prefix(std::min(rest.find_first_not_of(kBlanks), rest.size()));
    if (rest.empty()) break;
    std::string_view word = rest.substr(0, rest.find_first_of(kBlanks));
    rest.remove_prefix(word.size());
    if (word.starts_with('+')) word.remove_prefix(1);
    double value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc{} || end != word.data() + word.size())
      fail(ErrorKind::data, "{}: '{}' is not a number", where, word.substr(0, 40));
    numbers.push_back(checked_input(value, where));
  }
  if (numbers.size() != count)
    fail(ErrorKind::data, "{}: expected {} numbers, found {}", where, count, numbers.size());
  return numbers;
}

}  // namespace ubs
