// SPDX-License-Identifier: Apache-2.0
// See distill.hpp.
#include "host/api/distill.hpp"

#include <algorithm>

#include "host/api/model_session.hpp"
#include "host/base/stopwatch.hpp"
#include "host/data/gaussian_model.hpp"
#include "host/data/image.hpp"
#include "host/scene/scene_unit.hpp"
#include "host/train/measure_steps.hpp"
#include "host/train/trainer.hpp"

namespace ubs {
namespace {

// Returns the same splats with harmonics of this degree: missing ones are zero, higher ones are dropped.
ImportedSplats with_degree(const ImportedSplats& splats, int degree) {
  ImportedSplats out = splats;
  out.sh_degree = degree;
  out.resize(splats.count());
  std::ranges::fill(out.sh, 0.0f);
  const std::size_t from = 3 * splats.coefficients(), to = 3 * out.coefficients();
  for (std::size_t i = 0; i < splats.count(); ++i)
    std::copy_n(&splats.sh[i * from], std::min(from, to), &out.sh[i * to]);
  return out;
}

double unit_of(const Split& views, const SplatModel& model) {
  PointCloud centres;
  for (std::size_t i = 0; i < model.count; ++i)
    centres.positions.push_back({model.row(0)[i], model.row(1)[i], model.row(2)[i]});
  return median_depth(cameras_of(views), centres).value_or(1);
}

// Returns the settings for the training. They keep the number of splats constant.
TrainSettings distilling_settings(const TrainSettings& drawing, const SplatModel& initial) {
  TrainSettings s = fast_settings();
  s.dim = 3;
  s.variant = initial.variant;
  s.eps2d = kGaussianBlur;
  s.background = drawing.background;
  s.near_plane = planes_of(drawing).near;
  s.far_plane = planes_of(drawing).far;
  s.cap_max = static_cast<int>(initial.count);
  s.chosen = {"cap_max"};
  s.refine.end = s.refine.first;
  s.save_renders = 0;
  return s;
}

}  // namespace

Distiller::Distiller(std::shared_ptr<Device> device, const MixedModel& model, TrainSettings drawing,
                     Split views, int degree)
    : device_(std::move(device)),
      model_(model),
      drawing_(std::move(drawing)),
      views_{views.name, {}},
      degree_(degree) {
  // All views are rendered with the same time value, so one of several views that differ only in time is
  // enough.
  for (View& view : views.views) {
    view.camera.time = 0;
    if (std::ranges::find(views_.views, view.camera, &View::camera) == views_.views.end())
      views_.views.push_back(std::move(view));
  }
}

Split Distiller::pictures(double time) {
  Split split = views_;
  for (View& view : split.views) {
    view.camera.time = time;
    view.source = nullptr;
    view.masked = false;
  }
  ModelSession session(device_, model_, drawing_, false);
  session.renderer().set_cameras(cameras_of(split));
  for (std::size_t v = 0; v < split.views.size(); ++v) {
    session.renderer().forward(session.model().view(), static_cast<std::uint32_t>(v), session.settings(),
                               false);
    const RenderedView drawn = session.renderer().download();
    split.views[v].image = image_from_interleaved(drawn.rgb, drawn.width, drawn.height);
  }
  return split;
}

Distilled Distiller::at(double time, const ImportedSplats& closed_form, double seconds) {
  const Stopwatch watch;
  Split train = pictures(time);
  SplatModel initial = exact_model(with_degree(closed_form, degree_));
  TrainSettings settings = distilling_settings(drawing_, initial);
  const double unit = settings.unit = unit_of(train, initial);
  settings = in_unit(settings);
  scale_lengths(train, 1 / unit);
  scale_lengths(initial, 1 / unit);
  if (costs_.empty()) costs_ = measure_steps(*device_, settings, train, initial, initial.count);
  const double left = seconds - watch.seconds();
  const bool enough = expected_seconds(kMinIterations, costs_, settings, train, initial.count) <= left;
  const BudgetedRun run =
      enough ? choose_iterations({.seconds = left, .costs = costs_}, settings, train, initial.count)
             : BudgetedRun{fast_settings_for(settings, kMinIterations, initial.count), {}};
  Trainer trainer(*device_, run.settings, train, train, initial);
  if (enough) trainer.keep_to(run.budget);
  Distilled out;
  out.before = trainer.evaluate_test().mean.psnr_channel_mean;
  trainer.run([&](const StepReport& report) {
    if (report.test) out.after = report.test->mean.psnr_channel_mean;
    return true;
  });
  SplatModel model = trainer.model();
  scale_lengths(model, unit);
  out.splats = to_imported_splats(model);
  out.splats.offset = closed_form.offset;
  out.iterations = trainer.iteration();
  out.seconds = watch.seconds();
  return out;
}

}  // namespace ubs
