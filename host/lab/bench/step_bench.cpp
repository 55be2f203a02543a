// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/step_bench.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/run_settings.hpp"

namespace ubs::bench {
namespace {

constexpr double kGrowth = 1.02;        // ratio of the numbers of splats after and before a refinement
constexpr float kDeadOpacity = -6.0f;   // raw opacity; its sigmoid is 0.0025
constexpr std::size_t kDeadEvery = 50;  // every 50th splat is dead before a refinement

std::uint32_t grown_count(const SplatModel& model) {
  return static_cast<std::uint32_t>(std::ceil(kGrowth * static_cast<double>(model.count)));
}

KernelConfig config_of(const BenchScene& scene, RasterKind raster, const TrainSettings& training,
                       const DeviceInfo& device) {
  KernelConfig config = kernel_config(scene.model.dim, scene.model.variant, training, device);
  config.raster = raster;
  config.frozen = frozen_groups(scene.model.layout(), training.freeze);
  return config;
}

}  // namespace

StepBench::StepBench(Device& device, const BenchScene& scene, RasterKind raster,
                     const TrainSettings& training)
    : device_(device),
      scene_(scene),
      config_(config_of(scene, raster, training, device.info())),
      stages_(make_stages(device, config_)),
      model_(device, scene.model, grown_count(scene.model)),
      renderer_(device, stages_),
      grown_(grown_count(scene.model)) {
  device_.reset_peak();
  settings_.background = scene.background;
  renderer_.set_cameras(cameras_of(scene.views));

  const std::size_t size =
      static_cast<std::size_t>(trained_rows(model_.layout(), config_.frozen)) * model_.stride();
  for (auto [buffer, label] : {std::pair{&v_params_, "parameter gradients"},
                               {&moment1_, "first moments"},
                               {&moment2_, "second moments"}}) {
    *buffer = Buffer<float>(device, label, size);
    buffer->zero();
  }
  learning_rates_ = Buffer<float>(device, "learning rates", static_cast<std::size_t>(model_.rows()));
  learning_rates_.zero();  // with rates of 0, a step does all its work without changing the model
  sums_ = Buffer<float>(device, "loss sums", 8);
  const std::vector<std::uint8_t> target = planar(scene.views.views[0].image.rgb);
  target_ = Buffer<std::uint8_t>(device, "target image", target.size());
  target_.upload(target);
  step();
  save_model();
  restore_model();
}

void StepBench::step() {
  totals_ = renderer_.forward(model_.view(), 0, settings_, true);
  stages_.image_loss({.shape = renderer_.shape(),
                      .image = renderer_.image(),
                      .target = target_.view(),
                      .target_float = {},
                      .v_image = renderer_.v_image(),
                      .sums = sums_.view()});
  renderer_.backward(v_params_.view(), false);
  stages_.regularise({.splats = model_.view(), .v_params = v_params_.view(), .weights = {.opacity = 0.01f}});
  stages_.adam({.splats = model_.view(),
                .v_params = v_params_.view(),
                .moment1 = moment1_.view(),
                .moment2 = moment2_.view(),
                .learning_rates = learning_rates_.view()});
}

void StepBench::save_model() {
  // The peak memory includes the scratch memory of the refinement, but not the copies that are made for
  // repeating it.
  const auto view = [&] { return model_.view(); };
  stages_.relocate({.splats = view(), .moment1 = moment1_.view(), .moment2 = moment2_.view()});
  peak_bytes_ = device_.peak_bytes();
  for (int r = 0; r < model_.rows(); ++r)
    device_.write(*view().params.memory, static_cast<std::size_t>(r) * model_.stride() * sizeof(float),
                  std::as_bytes(scene_.model.row(r)));
  const std::size_t size = static_cast<std::size_t>(model_.rows()) * model_.stride();
  saved_ = Buffer<float>(device_, "saved parameters", size);
  device_.copy(*view().params.memory, 0, *saved_.view().memory, 0, size * sizeof(float));
  std::vector<float> opacities(model_.stride(), 0.0f);
  std::ranges::copy(scene_.model.row(model_.layout().opacity), opacities.begin());
  for (std::size_t i = 0; i < model_.count(); i += kDeadEvery) opacities[i] = kDeadOpacity;
  dead_opacities_ = Buffer<float>(device_, "dead opacities", opacities.size());
  dead_opacities_.upload(opacities);
}

void StepBench::restore_model() {
  Memory& params = *model_.view().params.memory;
  device_.copy(*saved_.view().memory, 0, params, 0, saved_.size() * sizeof(float));
}

Repeated StepBench::repeated(const std::string& stage) {
  Stages& stages = stages_.real();
  const auto prepare = [this] {
    restore_model();
    const auto row = static_cast<std::size_t>(model_.layout().opacity);
    device_.copy(*dead_opacities_.view().memory, 0, *model_.view().params.memory,
                 row * model_.stride() * sizeof(float), dead_opacities_.size() * sizeof(float));
  };
  if (stage == "lists")
    return {[&] {
              stages_.repeat<CountLists>();
              stages_.repeat<BuildLists>();
            },
            {}};
  if (stage == "learn")  // the learning rates are 0, so the model does not change
    return {[&] {
              stages.learn(
                  {stages_.last<ProjectBackward>(), stages_.last<Regularise>(), stages_.last<AdamStep>()});
            },
            {}};
  if (stage == "relocate")
    return {
        [&] {
          stages.relocate({.splats = model_.view(), .moment1 = moment1_.view(), .moment2 = moment2_.view()});
        },
        prepare};
  if (stage == "grow")
    return {[&] {
              stages.grow({.splats = model_.view(),
                           .target = grown_,
                           .moment1 = moment1_.view(),
                           .moment2 = moment2_.view()});
            },
            prepare};
  if (stage == "noise")
    return {[&] { stages.add_noise({.splats = model_.view(), .amount = 1e-6f}); }, prepare};
  if (stage == "forward_backward")  // uses the image gradient of the previous step
    return {[&] {
              renderer_.forward(model_.view(), 0, settings_, true);
              renderer_.backward(v_params_.view(), false);
            },
            {}};
  if (const Operation* last = stages_.last(stage)) return {[&stages, last] { stages.run(*last); }, {}};
  fail(ErrorKind::internal, "unknown stage '{}'", stage);
}

std::vector<std::vector<float>> StepBench::outputs() const {
  std::vector<std::vector<float>> values{renderer_.download().rgb};
  const std::vector<float> gradients = v_params_.download();
  const std::size_t count = model_.count(), stride = model_.stride();
  for (std::size_t row = 0; row < gradients.size() / stride; ++row)
    values.emplace_back(gradients.begin() + static_cast<std::ptrdiff_t>(row * stride),
                        gradients.begin() + static_cast<std::ptrdiff_t>(row * stride + count));
  return values;
}

Measured StepBench::measure(const std::string& stage, const SamplingLimits& limits) {
  const Repeated operation = repeated(stage);
  const Measured measured = bench::measure(device_, operation, limits);
  if (operation.prepare) restore_model();
  device_.finish();
  return measured;
}

}  // namespace ubs::bench
