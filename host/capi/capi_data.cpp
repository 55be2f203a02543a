// SPDX-License-Identifier: Apache-2.0
// This file implements the C interface for data sets, which are opened from files or made from arrays.
#include <cmath>

#include "host/capi/handles.hpp"
#include "host/dataset/synthetic.hpp"
#include "host/dataset/view_names.hpp"
#include "host/run/open_data.hpp"

namespace ubs::facade {
namespace {

constexpr std::size_t kExtras = std::size(ubs_camera{}.extra);

const Split& split_of(const ubs_data* data, const char* split) {
  const Split* found = given(data, "data").set->find(&given(split, "split"));
  if (!found) fail(ErrorKind::usage, "there is no split '{}'", split);
  return *found;
}

const View& view_of(const ubs_data* data, const char* split, std::size_t index) {
  const Split& found = split_of(data, split);
  if (index >= found.views.size())
    fail(ErrorKind::usage, "view {} does not exist: split '{}' has {} views", index, split,
         found.views.size());
  return found.views[index];
}

void check_split_name(const std::string& name) {
  if (name != "train" && name != "test" && name != "val")
    fail(ErrorKind::usage, "unknown split '{}': expected train, test or val", name);
}

Split& split_to_fill(Dataset& set, const std::string& name) {
  for (Split& split : set.splits)
    if (split.name == name) return split;
  return set.splits.emplace_back(Split{name, {}});
}

// Returns the data set, so that the caller can change it. Throws if a trainer uses the data set, because the
// trainer refers to its views.
Dataset& to_change(ubs_data* data) {
  if (given(data, "data").set.use_count() > 1)
    fail(ErrorKind::usage, "the data set cannot be changed while a trainer uses it");
  return *data->set;
}

// Checks and returns the name of a new view. A null `name` is replaced by the index of the view. `split` is
// null if the split has no views yet.
std::string checked_name(const char* name, const Split* split) {
  const std::string text = name ? name : std::to_string(split ? split->views.size() : 0);
  if (safe_file_name(text) != text)
    fail(ErrorKind::usage, "'{}' is not a valid view name: it must be usable as a file name", text);
  if (!split) return text;
  for (const View& view : split->views)
    if (view.name == text) fail(ErrorKind::usage, "split '{}' already has a view '{}'", split->name, text);
  return text;
}

}  // namespace

Camera camera_from(const ubs_camera& from) {
  Camera camera;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column)
      camera.rotation[3 * row + column] = from.world_to_camera[4 * row + column];
    camera.translation[row] = from.world_to_camera[4 * row + 3];
  }
  camera.fx = from.fx;
  camera.fy = from.fy;
  camera.cx = from.cx;
  camera.cy = from.cy;
  camera.width = from.width;
  camera.height = from.height;
  camera.time = from.time;
  if (from.extra_count > kExtras)
    fail(ErrorKind::usage, "a camera can have at most {} further query values, but has {}", kExtras,
         from.extra_count);
  camera.extra.assign(from.extra, from.extra + from.extra_count);
  return camera;
}

ubs_camera camera_to(const Camera& from) {
  ubs_camera camera{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column)
      camera.world_to_camera[4 * row + column] = from.rotation[3 * row + column];
    camera.world_to_camera[4 * row + 3] = from.translation[row];
  }
  camera.fx = from.fx;
  camera.fy = from.fy;
  camera.cx = from.cx;
  camera.cy = from.cy;
  camera.width = from.width;
  camera.height = from.height;
  camera.time = from.time;
  camera.extra_count = static_cast<std::uint32_t>(std::min(from.extra.size(), kExtras));
  std::copy_n(from.extra.begin(), camera.extra_count, camera.extra);
  return camera;
}

Camera camera_for(const LoadedModel& model, const ubs_camera* camera) {
  std::vector<View> one{View{.name = "camera", .camera = camera_from(taken(camera, "camera"))}};
  const Camera& found = one[0].camera;
  check_camera(found, "the camera");
  for (const SplatModel& group : model.model.groups)
    if (const std::size_t needed = further_queries(group.dim); found.extra.size() < needed)
      fail(ErrorKind::usage,
           "the member `extra` of the camera has {} values, but a model with N = {} requires {} query values "
           "besides direction and time",
           found.extra.size(), group.dim, needed);
  rebase(one, {0, 0, 0}, model.offset);
  return one[0].camera;
}

}  // namespace ubs::facade

using namespace ubs;
using namespace ubs::facade;

ubs_status ubs_data_open(const char* path, const ubs_settings* settings, ubs_data** data) {
  return made(data, [&] {
    const TrainSettings values = settings ? settings->values : TrainSettings{};
    auto opened = std::make_unique<ubs_data>();
    *opened->set = open_dataset(&given(path, "path"), {}, values, Images::load);
    opened->settings = values;
    warn_skipped(opened->set->report);
    return opened;
  });
}

ubs_status ubs_data_synthesise(const ubs_synthetic* scene, const char* folder) {
  return guarded([&] {
    const ubs_synthetic from = taken(scene, "scene");
    SyntheticOptions options;
    const auto choose = [](int& option, std::int32_t value) {
      if (value != 0) option = value;
    };
    options.scene = &given(from.scene, "scene.scene");
    choose(options.width, from.width);
    choose(options.height, from.height);
    choose(options.train_views, from.train_views);
    choose(options.test_views, from.test_views);
    choose(options.val_views, from.val_views);
    choose(options.supersampling, from.supersampling);
    if (from.test_views == -1) options.test_views = 0;
    options.seed = from.seed;
    options.overwrite = from.overwrite != 0;
    export_synthetic(options, &given(folder, "folder"));
  });
}

ubs_status ubs_data_create(ubs_data** data) {
  return made(data, [] {
    auto created = std::make_unique<ubs_data>();
    created->set->report.folder = "arrays";
    created->set->report.layout = "arrays";
    return created;
  });
}

void ubs_data_free(ubs_data* data) { delete data; }

ubs_status ubs_data_add_view(ubs_data* data, const char* split, const char* name, const ubs_camera* camera,
                             const uint8_t* rgb, const uint8_t* mask) {
  return guarded([&] {
    Dataset& set = to_change(data);
    std::vector<View> one(1);
    View& view = one[0];
    view.camera = camera_from(taken(camera, "camera"));
    check_split_name(&given(split, "split"));
    view.name = checked_name(name, set.find(split));
    check_camera(view.camera, fmt::format("view '{}'", view.name));
    if (view.camera.time < 0 || view.camera.time > 1)
      fail(ErrorKind::usage, "view '{}': time = {} is outside of 0 to 1", view.name, view.camera.time);
    const auto pixels =
        static_cast<std::size_t>(view.camera.width) * static_cast<std::size_t>(view.camera.height);
    if (mask && !rgb) fail(ErrorKind::usage, "view '{}' has a mask but no image", view.name);
    if (rgb) view.image = {view.camera.width, view.camera.height, {rgb, rgb + 3 * pixels}, {}};
    if (mask) view.image.mask.assign(mask, mask + pixels);
    view.masked = mask != nullptr;
    view.opaque = rgb != nullptr;
    rebase(one, {0, 0, 0}, set.offset);
    split_to_fill(set, split).views.push_back(std::move(view));
  });
}

ubs_status ubs_data_set_points(ubs_data* data, size_t count, const float* positions, const uint8_t* colours) {
  return guarded([&] {
    Dataset& set = to_change(data);
    if (count == 0) fail(ErrorKind::usage, "count is 0: pass at least one point");
    given(positions, "positions");
    PointCloud points;
    constexpr std::uint8_t kGrey = 127;  // the readers of point files use the same colour
    for (std::size_t i = 0; i < count; ++i) {
      const std::array<double, 3> world{positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]};
      check_point(world, i, "points");
      auto& position = points.positions.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) position[k] = static_cast<float>(world[k] - set.offset[k]);
      if (colours)
        points.colours.push_back({colours[3 * i], colours[3 * i + 1], colours[3 * i + 2]});
      else
        points.colours.push_back({kGrey, kGrey, kGrey});
    }
    set.points = std::move(points);
  });
}

ubs_status ubs_data_view_count(const ubs_data* data, const char* split, size_t* count) {
  return guarded([&] {
    const Split* found = given(data, "data").set->find(&given(split, "split"));
    given(count, "count") = found ? found->views.size() : 0;
  });
}

ubs_status ubs_data_get_view(const ubs_data* data, const char* split, size_t index, ubs_view* view) {
  return guarded([&] {
    std::vector<View> one(1);
    const View& from = view_of(data, split, index);
    one[0].camera = from.camera;
    rebase(one, data->set->offset, {0, 0, 0});
    ubs_view values{};
    values.camera = camera_to(one[0].camera);
    values.camera.size = sizeof(ubs_camera);
    values.has_image = from.has_image();
    values.has_mask = from.masked;
    put_text(values.name, from.name);
    put(view, values, "view");
  });
}

ubs_status ubs_data_get_image(const ubs_data* data, const char* split, size_t index, uint8_t* rgb,
                              uint8_t* mask) {
  return guarded([&] {
    const View& view = view_of(data, split, index);
    if (!view.has_image()) fail(ErrorKind::data, "view '{}' of split '{}' has no image", view.name, split);
    const Image8 image = view.load_image();
    if (rgb) std::ranges::copy(image.rgb, rgb);
    if (!mask) return;
    if (image.mask.empty())
      std::memset(mask, 255, static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height));
    else
      std::ranges::copy(image.mask, mask);
  });
}
