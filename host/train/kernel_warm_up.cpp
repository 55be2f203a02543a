// SPDX-License-Identifier: Apache-2.0
#include "host/train/kernel_warm_up.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "host/base/stopwatch.hpp"
#include "host/device/operations.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/settings/schedule.hpp"
#include "host/train/evaluate.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/target_loss.hpp"

namespace ubs {
namespace {

constexpr std::size_t kFewSplats = 4096;  // maximum number of splats in the warm-up of each view
// Models with at least this number of splats use other kernels for sorting (host/opencl/lists.cpp).
constexpr std::size_t kManySplats = std::size_t{1} << 20;

// Returns views that may need different kernels: the smallest view, the largest view, a view with a mask and
// a view without a mask.
std::vector<const View*> different_views(const Split& split) {
  std::vector<const View*> views;
  const auto take = [&](auto at) {
    if (at != split.views.end() && std::ranges::find(views, &*at) == views.end()) views.push_back(&*at);
  };
  const auto pixels = [](const View& view) {
    return static_cast<double>(view.camera.width) * view.camera.height;
  };
  take(std::ranges::min_element(split.views, {}, pixels));
  take(std::ranges::max_element(split.views, {}, pixels));
  take(std::ranges::find(split.views, true, &View::masked));
  take(std::ranges::find(split.views, false, &View::masked));
  return views;
}

}  // namespace

KernelWarmUp::KernelWarmUp(Device& device, const TrainSettings& settings, const View& view,
                           const SplatModel& model)
    : device_(device),
      settings_(settings),
      view_{"warm-up", {view}},
      stages_(make_stages(device, training_config(settings, device.info()))),
      model_(device, model, model.count + 64),
      targets_(device, kTargetBudgetBytes),
      sums_(device, "loss sums", 8),
      rates_(device, "learning rates", static_cast<std::size_t>(model_.rows())),
      sentinel_(device, "sentinel", 1) {
  const std::size_t size = static_cast<std::size_t>(model_.rows()) * model_.stride();
  for (auto [buffer, label] : {std::pair{&v_params_, "parameter gradients"},
                               {&moment1_, "first moments"},
                               {&moment2_, "second moments"}}) {
    *buffer = Buffer<float>(device, label, size);
    buffer->zero();
  }
  rates_.zero();
  sentinel_.zero();
  targets_.add(view_);
}

void KernelWarmUp::learn(Stages& stages) {
  Renderer renderer(device_, stages);
  renderer.set_cameras(cameras_of(view_));
  const RenderSettings render = render_settings(settings_);
  renderer.forward(model_.view(), 0, render, true);
  if (lists_uncounted(settings_, device_.info()))
    renderer.forward_deferred(model_.view(), 0, render).totals();
  ImageLoss loss = training_loss(renderer, targets_.get(0), settings_, sums_.view());
  Buffer<float> appearance, v_appearance;
  if (settings_.appearance != Appearance::none) {
    appearance = Buffer<float>(device_, "appearance", kAppearanceState);
    appearance.zero();
    v_appearance = Buffer<float>(device_, "appearance gradients", kAppearanceNumbers);
    loss.appearance = appearance.view();
    loss.v_appearance = v_appearance.view();
  }
  stages.image_loss(loss);
  if (appearance)
    stages.appearance_step({.state = appearance.view(),
                            .images = 1,
                            .image = 0,
                            .gradient = v_appearance.view(),
                            .rate_diagonal = 1e-3f,
                            .rate_other = 1e-3f});
  if (render.sky) {
    const Buffer<float> v_sky(device_, "sky gradients", kSkyNumbers);
    renderer.sky_gradient(v_sky.view(), 0);
    stages.sky_step({.state = renderer.sky(), .gradient = v_sky.view(), .views = 1, .rate = 1e-3f});
    device_.finish();
  }
  renderer.backward_to_records();
  const Regularise penalty{
      .splats = model_.view(), .v_params = v_params_.view(), .weights = penalty_weights(settings_)};
  AdamStep step{.splats = model_.view(),
                .v_params = v_params_.view(),
                .moment1 = moment1_.view(),
                .moment2 = moment2_.view(),
                .learning_rates = rates_.view()};
  if (settings_.on_nan != OnNan::off) step.sentinel = sentinel_.view();
  step.stamp = 1;
  const bool refines = !settings_.refine.empty();
  renderer.learn(false, penalty, step);  // learning rates are 0
  if (settings_.batch > 1 || refines) {
    const BufferView<float> gradient = v_params_.view();
    renderer.backward_from_records(std::span(&gradient, 1), false);
  }
  if (refines) {
    stages.regularise(penalty);
    stages.adam(step);
  }
  if (!refines) return;
  stages.relocate({.splats = model_.view(),
                   .moment1 = moment1_.view(),
                   .moment2 = moment2_.view(),
                   .spread = static_cast<float>(settings_.copy_spread)});
  if (settings_.growth > 1 && settings_.cap_max > static_cast<int>(model_.count()))
    stages.grow({.splats = model_.view(),
                 .target = model_.count() + 1,
                 .moment1 = moment1_.view(),
                 .moment2 = moment2_.view()});
  if (settings_.noise_lr != 0) stages.add_noise({.splats = model_.view(), .amount = 1e-12f});
}

void KernelWarmUp::evaluate(ImageMetrics* more) {
  Renderer renderer(device_, *stages_);
  renderer.set_cameras(cameras_of(view_));
  ubs::evaluate(device_, *stages_, renderer, model_.view(), render_settings(settings_), view_.views, targets_,
                0, more);
}

SplatModel copies(const SplatModel& model, std::size_t target) {
  SplatModel grown(model.dim, target, model.variant);
  const int opacity = model.layout().opacity;
  const double each = static_cast<double>(model.count) / static_cast<double>(target);
  for (int r = 0; r < model.layout().count; ++r)
    for (std::size_t i = 0; i < target; ++i) {
      float value = model.row(r)[i % model.count];
      if (r == opacity) {
        const double passes = std::pow(1 / (1 + std::exp(static_cast<double>(value))), each);
        value = static_cast<float>(std::log(std::max(1 - passes, 1e-9) / std::max(passes, 1e-9)));
      }
      grown.row(r)[i] = value;
    }
  return grown;
}

double view_seconds(Device& device, const Plan& plan, const Split& train, const SplatModel& model) {
  constexpr std::size_t kMaxMeasured = 200'000;
  constexpr int kTimes = 5;
  KernelWarmUp warm_up(device, plan.settings(), train.views[0],
                       copies(model, std::min(model.count, kMaxMeasured)));
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kTimes; ++i) {
    const Stopwatch watch;
    warm_up.learn(warm_up.stages());
    device.finish();
    least = std::min(least, watch.seconds());
  }
  return least;
}

void build_kernels(Device& device, const Plan& plan, const Split& train, const Split& test,
                   const SplatModel& initial, ImageMetrics* more) {
  const TrainSettings& settings = plan.settings();
  if (initial.count == 0) return;
  const SplatModel few = copies(initial, std::min(initial.count, kFewSplats));
  const int coarsest = pyramid_levels(settings, train).front().factor;
  for (const View* view : different_views(train)) {
    KernelWarmUp warm_up(device, settings, *view, few);
    warm_up.learn(warm_up.stages());
    if (coarsest == 1) continue;
    View small = *view;
    small.camera = reduced(view->camera, coarsest);
    small.image = reduced(view->load_image(), coarsest);
    small.source = nullptr;
    KernelWarmUp on_coarse(device, settings, small, few);
    on_coarse.learn(on_coarse.stages());
  }
  for (const View* view : different_views(test)) KernelWarmUp(device, settings, *view, few).evaluate(more);
  if (Schedule(settings, initial.count).splats_at(1.0) >= kManySplats) {
    KernelWarmUp warm_up(device, settings, train.views[0], copies(initial, kManySplats));
    warm_up.learn(warm_up.stages());
  }
  device.finish();
  device.reset_peak();
  const std::size_t most = std::max(initial.count, static_cast<std::size_t>(settings.cap_max));
  check_fits(plan_memory(memory_question(settings, train, test, device.info(), most)), device.info());
}

}  // namespace ubs
