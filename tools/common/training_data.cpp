// SPDX-License-Identifier: Apache-2.0
#include "tools/common/training_data.hpp"

#include <algorithm>

#include "host/scene/choose_dim.hpp"
#include "host/scene/frustum_points.hpp"
#include "host/scene/initialise.hpp"
#include "host/train/run_settings.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

Split take_train(Dataset& data, TrainSettings& settings) {
  Split train = take_split(data, "train");
  require_images(train);
  if (settings.dim == kAutoInt) {
    const DimChoice choice = choose_dim(train.views);
    settings.dim = choice.dim;
    validate(settings);
    data.report.notes.push_back(fmt::format("dim auto: N = {}, {}", choice.dim, choice.reason));
  }
  check_query(train, settings.dim);
  const auto same_time = [&](const View& view) { return view.camera.time == train.views[0].camera.time; };
  if (has_time(settings.dim) && std::ranges::all_of(train.views, same_time))
    warn(
        "all training views have the same time: N = {} learns nothing from it; for a static scene use --dim "
        "{}",
        settings.dim, settings.dim >= 6 ? 6 : 3);
  return train;
}

Split take_test(Dataset& data, const TrainSettings& settings) {
  if (!data.find("test")) {
    warn("{} has no test split: no measurements, no renders", data.report.folder);
    return {"test", {}};
  }
  Split test = take_split(data, "test");
  check_query(test, settings.dim);
  const std::size_t all = test.views.size();
  std::erase_if(test.views, [](const View& view) { return !view.has_image(); });
  if (test.views.size() < all)
    warn("{} of {} test views have no image and are left out", all - test.views.size(), all);
  return test;
}

SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& s) {
  const InitOptions init = init_options(s);
  const auto points = static_cast<std::size_t>(s.init_points);
  if (data.points)
    return initialise_from_points(s.dim, data.points->positions, data.points->colours, s.seed, init);
  if (data.depth_bounds.size() == train.views.size()) {
    const PointCloud cloud = sample_frusta(train.views, data.depth_bounds, points, s.seed);
    return initialise_from_points(s.dim, cloud.positions, cloud.colours, s.seed, init);
  }
  return initialise_random(s.dim, points, s.seed, init);
}

}  // namespace ubs::tools
