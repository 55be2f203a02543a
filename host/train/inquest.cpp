// SPDX-License-Identifier: Apache-2.0
#include "host/train/inquest.hpp"

#include <cmath>

#include "host/base/error.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/train/stage_inspector.hpp"

namespace ubs {
namespace {

AdamUndo undo_of(std::vector<float> rates, std::uint64_t adam_steps) {
  const AdamStep step;
  const auto steps = static_cast<double>(adam_steps);
  return {std::move(rates), 1 / (1 - std::pow(step.beta1, steps)),
          1 / std::sqrt(1 - std::pow(step.beta2, steps)), step.epsilon};
}

SplatModel without_nonfinite(SplatModel model, std::size_t& replaced) {
  for (float& value : model.values)
    if (!std::isfinite(value)) {
      value = 0;
      ++replaced;
    }
  return model;
}

std::vector<float> gradient_of(const Buffer<float>& v_params, std::size_t stride, std::int64_t splat) {
  std::vector<float> gradient;
  const std::vector<float> all = v_params.download();
  for (std::size_t at = static_cast<std::size_t>(splat); at < all.size(); at += stride)
    gradient.push_back(all[at]);
  return gradient;
}

}  // namespace

void find_cause(Device& device, Stages& stages, TrainingViews& views, const RenderSettings& settings,
                std::vector<float> rates, const TrainState& state, NonFiniteEvent& event) {
  const SplatModel before = undo_adam(state, undo_of(std::move(rates), state.adam_steps));
  event.model = without_nonfinite(before, event.replaced);
  if (event.replaced > 0) {
    event.stage = "parameters";
    event.where =
        fmt::format("{} of them before the iteration: an earlier refinement, noise, or a change from outside",
                    event.replaced);
    return;
  }
  event.stage = "adam";
  event.where =
      "gradients and parameters are finite, moments are not: squares overflow from gradients of 6e20 on";
  try {
    DeviceModel model(device, before);
    Buffer<float> v_params(device, "parameter gradients",
                           static_cast<std::size_t>(model.rows()) * model.stride());
    Buffer<float> sums(device, "loss sums", 8);
    const std::uint64_t first = views.first_draw(event.iteration);
    for (std::uint64_t draw = first; draw < first + views.batch(); ++draw) {
      const std::uint32_t view = views.view_of(draw);
      StageInspector inspector(device, stages);
      Renderer renderer(device, inspector);
      renderer.set_cameras({views.camera(view)});
      if (!state.sky.empty()) renderer.set_sky(settings.sky.value(), state.sky);
      renderer.forward(model.view(), 0, settings, true);
      inspector.image_loss(views.loss(renderer, draw, sums.view()));
      renderer.backward(v_params.view(), false);
      if (event.splat >= 0) event.gradient = gradient_of(v_params, model.stride(), event.splat);
      event.view = view;
      event.view_name = views.train().views[view].name;
      if (!inspector.finding()) continue;
      const StageFinding& finding = *inspector.finding();
      event.stage = finding.stage;
      event.where = finding.where;
      if (event.splat < 0 && finding.splat >= 0) {
        event.splats = {static_cast<std::uint32_t>(finding.splat)};
        describe_splat(state, event);
      } else if (finding.splat >= 0 && finding.splat != event.splat) {
        event.where += fmt::format(" (splat {})", finding.splat);
      }
      return;
    }
    if (views.batch() > 1) {  // any of them, or their sum
      event.view = -1;
      event.view_name.clear();
    }
  } catch (const Error& error) {
    event.stage = "unknown";
    event.where = fmt::format("the iteration could not be repeated: {}", error.what());
  }
}

}  // namespace ubs
