// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/bench_data.hpp"

#include "host/base/error.hpp"
#include "host/formats/splat_file.hpp"
#include "host/run/open_data.hpp"

namespace ubs::tools {
namespace {

// Maximum number of views that a model is measured with. The mean over so many views is accurate enough, and
// their images fit into memory.
constexpr std::size_t kMaxViews = 32;

Split shown_views(Dataset& data) {
  const Split* test = data.find("test");
  return take_split(data, test && !test->views.empty() ? "test" : "train");
}

bench::SceneSize size_of(const Split& split, std::size_t splats) {
  const Camera& camera = split.views.front().camera;
  return {splats, camera.width, camera.height};
}

}  // namespace

bench::SceneSize bench_model_size(const std::string& model, const std::string& data,
                                  const TrainSettings& settings, const std::optional<OpenedData>& opened) {
  Dataset set = open_dataset(opened, data, {}, settings, Images::skip);
  return size_of(shown_views(set), load_splat_model(model).model.count());
}

bench::BenchScene open_bench_model(const std::string& model, const std::string& data,
                                   const TrainSettings& settings, const std::optional<OpenedData>& opened) {
  const auto file = load_splat_model(model);
  bench::BenchScene scene{file.model.groups.front(), {}, {}};
  if (file.model.mixed()) scene.mixed = file.model;
  for (std::size_t c = 0; c < 3; ++c) scene.background[c] = static_cast<float>(settings.background.colour[c]);
  Dataset set = open_dataset(opened, data, {}, settings, Images::load);
  warn_skipped(set.report);
  scene.views = shown_views(set);
  check_query(scene.views, file.model.dim());
  std::erase_if(scene.views.views, [](const View& view) { return !view.has_image(); });
  if (scene.views.views.empty())
    fail(ErrorKind::data, "{}: split '{}' has no views with images", data, scene.views.name);
  scene.views.views.resize(std::min(kMaxViews, scene.views.views.size()));
  for (View& view : scene.views.views) {
    view.image = view.load_image();
    view.source.reset();
  }
  if (set.offset != file.offset) rebase(scene.views.views, set.offset, file.offset);
  return scene;
}

}  // namespace ubs::tools
