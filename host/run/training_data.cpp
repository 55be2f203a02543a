// SPDX-License-Identifier: Apache-2.0
#include "host/run/training_data.hpp"

#include <algorithm>
#include <iterator>

#include "host/base/warning.hpp"
#include "host/data/foreign_formats.hpp"
#include "host/scene/choose_dim.hpp"
#include "host/scene/frustum_points.hpp"
#include "host/scene/initialise.hpp"
#include "host/spec/settings.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

// Every n-th: where the points are dense they stay dense.
PointCloud thinned(PointCloud points, std::size_t most) {
  const std::size_t all = points.positions.size();
  if (all <= most) return points;
  for (std::size_t i = 0; i < most; ++i) {
    points.positions[i] = points.positions[i * all / most];
    points.colours[i] = points.colours[i * all / most];
  }
  points.positions.resize(most);
  points.colours.resize(most);
  return points;
}

void note_cap(Dataset& data, const TrainSettings& settings) {
  const auto cap = static_cast<std::size_t>(settings.cap_max);
  if (data.points && data.points->positions.size() > cap) {
    data.report.notes.push_back(fmt::format("{} of {} points taken, evenly spaced: cap_max is {}", cap,
                                            data.points->positions.size(), cap));
  } else if (!data.points && settings.init_points > settings.cap_max) {
    data.report.notes.push_back(
        fmt::format("{} initial splats instead of {}: cap_max is {}", cap, settings.init_points, cap));
  }
}

}  // namespace

Split take_train(Dataset& data, TrainSettings& settings) {
  Split train = take_split(data, "train");
  settle_training(train, data, settings);
  return train;
}

void settle_training(const Split& train, Dataset& data, TrainSettings& settings) {
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
  note_cap(data, settings);
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

ModelNotes notes_for(const TrainSettings& settings, const Split& train) {
  TrainSettings copy = settings;
  std::vector<std::pair<std::string, std::string>> drawing;
  for (const FieldValue& field : bind_fields(copy, train_fields()))
    if (std::ranges::find(kNotedKeys, field.key) != std::end(kNotedKeys))
      drawing.emplace_back(field.key, field_text(field));
  return make_notes(std::move(drawing), cameras_of(train));
}

std::vector<std::string> model_comments(const Dataset& data, const TrainSettings& settings,
                                        const Split& train) {
  std::vector<std::string> comments;
  if (data.offset != std::array<double, 3>{}) comments.push_back(make_offset_comment(data.offset));
  std::ranges::copy(comments_of(notes_for(settings, train)), std::back_inserter(comments));
  return comments;
}

SplatModel initial_model(const Dataset& data, const Split& train, const TrainSettings& s) {
  const InitOptions init = init_options(s);
  const auto points = static_cast<std::size_t>(std::min(s.init_points, s.cap_max));
  if (data.points) {
    const PointCloud cloud = thinned(*data.points, static_cast<std::size_t>(s.cap_max));
    return initialise_from_points(s.dim, cloud.positions, cloud.colours, s.seed, init);
  }
  if (data.depth_bounds.size() == train.views.size()) {
    const PointCloud cloud = sample_frusta(train.views, data.depth_bounds, points, s.seed);
    return initialise_from_points(s.dim, cloud.positions, cloud.colours, s.seed, init);
  }
  return initialise_random(s.dim, points, s.seed, init);
}

}  // namespace ubs
