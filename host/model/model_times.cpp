// SPDX-License-Identifier: Apache-2.0
// See model_times.hpp.
#include "host/model/model_times.hpp"

#include <memory>
#include <vector>

#include "host/base/stopwatch.hpp"
#include "host/train/target_loss.hpp"

namespace ubs::reduce {
namespace {

// Step runs training steps of a model, and holds the buffers that training needs in addition to the model.
// The learning rates are zero, so a step does all of its computations but does not change the model.
class Step {
 public:
  Step(Device& device, const TimedModel& timed)
      : timed_(timed),
        gradients_(device, *timed.model, "parameter gradients"),
        moment1_(device, *timed.model, "first moments"),
        moment2_(device, *timed.model, "second moments"),
        sums_(device, "loss sums", 8) {
    for (const DeviceModel& group : timed.model->groups()) {
      rates_.emplace_back(device, "learning rates", static_cast<std::size_t>(group.rows()));
      rates_.back().zero();
    }
  }

  void run(std::uint32_t view, const RenderSettings& settings, const Target& target) {
    Renderer& renderer = *timed_.renderer;
    renderer.forward(timed_.model->view(), view, settings, true);
    ImageLoss loss = loss_of(renderer, target, sums_.view());
    loss.v_image = renderer.v_image();
    timed_.model->stages().image_loss(loss);
    renderer.backward(gradients_.view(), false);
    for (std::size_t g = 0; g < rates_.size(); ++g)
      timed_.model->stages(g).adam({.splats = timed_.model->groups()[g].view(),
                                    .v_params = gradients_.view()[g],
                                    .moment1 = moment1_.view()[g],
                                    .moment2 = moment2_.view()[g],
                                    .learning_rates = rates_[g].view()});
  }

 private:
  TimedModel timed_;
  GroupBuffers gradients_, moment1_, moment2_;
  Buffer<float> sums_;
  std::vector<Buffer<float>> rates_;
};

// Runs `work` and returns its wall time, until the device is idle.
template <typename Work>
double milliseconds(Device& device, const Work& work) {
  device.finish();
  const Stopwatch watch;
  work();
  device.finish();
  return watch.milliseconds();
}

}  // namespace

std::array<ModelTimes, 2> measure_times(Device& device, const std::array<TimedModel, 2>& models,
                                        const RenderSettings& settings, std::size_t views,
                                        TargetImages& targets, std::size_t rounds) {
  std::array<std::unique_ptr<Step>, 2> steps;
  for (std::size_t m = 0; m < 2; ++m) steps[m] = std::make_unique<Step>(device, models[m]);
  std::array<std::vector<double>, 2> render, step;
  for (std::size_t round = 0; round <= rounds; ++round) {
    const auto view = static_cast<std::uint32_t>(round * views / (rounds + 1));
    const Target target = targets.get(view);
    for (std::size_t turn = 0; turn < 2; ++turn) {
      const std::size_t m =
          // The model that is measured first alternates from round to round, because the second one benefits
          // from the caches that the first one has filled.
          (turn + round) % 2;
      const double drawn = milliseconds(
          device, [&] { models[m].renderer->forward(models[m].model->view(), view, settings, false); });
      const double stepped = milliseconds(device, [&] { steps[m]->run(view, settings, target); });
      if (round == 0) continue;
      render[m].push_back(drawn);
      step[m].push_back(stepped);
    }
  }
  std::array<ModelTimes, 2> times;
  for (std::size_t m = 0; m < 2; ++m) times[m] = {summarise(render[m]), summarise(step[m])};
  return times;
}

}  // namespace ubs::reduce
