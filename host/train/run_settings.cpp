// SPDX-License-Identifier: Apache-2.0
#include "host/train/run_settings.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "host/base/error.hpp"
#include "host/device/operations.hpp"
#include "host/device/tuning.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/scene/splat_model.hpp"
#include "host/settings/fields.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

KernelConfig kernel_config(int dim, const ModelVariant& variant, const TrainSettings& settings,
                           const DeviceInfo& device) {
  KernelConfig config;
  config.dim = dim;
  config.raster = raster_kind(settings.raster, device);
  config.query_grad = settings.query_grad;
  config.variant = variant;
  config.alpha_min = static_cast<float>(settings.alpha_min);
  config.math = settings.math;
  return config;
}

KernelConfig training_config(const TrainSettings& s, const DeviceInfo& device) {
  KernelConfig config = kernel_config(s.dim, s.variant, s, device);
  config.frozen = frozen_groups(ParameterLayout(s.dim, s.variant), s.freeze);
  return config;
}

RenderSettings render_settings(const TrainSettings& settings) {
  RenderSettings render;
  const auto [near, far] = planes_of(settings);
  render.projection = {static_cast<float>(near), static_cast<float>(far), static_cast<float>(settings.eps2d)};
  const Background& behind = settings.background;
  for (std::size_t c = 0; c < 3; ++c) render.background[c] = static_cast<float>(behind.colour[c]);
  if (behind.learnt == Background::Learnt::no && behind.harmonics.empty()) return render;
  auto& sky = render.sky.emplace();
  std::ranges::copy(render.background, sky.begin());
  for (std::size_t i = 0; i < behind.harmonics.size(); ++i)
    sky[3 + i] = static_cast<float>(behind.harmonics[i]);
  return render;
}

Background learnt_background(Background behind, const std::vector<float>& sky) {
  if (sky.empty()) return behind;
  std::copy_n(sky.begin(), 3, behind.colour.begin());
  if (behind.learnt == Background::Learnt::sky)
    behind.harmonics.assign(sky.begin() + 3, sky.begin() + kSkyNumbers);
  behind.learnt = Background::Learnt::no;
  return behind;
}

InitOptions init_options(const TrainSettings& settings) {
  InitOptions init;
  if (settings.init_extent != kAuto) init.box = settings.init_extent;
  init.variant = settings.variant;
  if (settings.beta_dir_init != kAuto) init.beta_dir = settings.beta_dir_init;
  init.beta_query = settings.beta_query_init;
  return init;
}

void check_initial(const TrainSettings& settings, const SplatModel& initial) {
  if (initial.dim != settings.dim)
    fail(ErrorKind::usage, "the model has {} dimensions, but the settings have {}", initial.dim,
         settings.dim);
  if (initial.variant != settings.variant)
    fail(ErrorKind::usage, "the model has the variant '{}', but the settings have '{}'",
         to_string(initial.variant), to_string(settings.variant));
}

std::vector<std::string> kernel_assignments(const TrainSettings& settings) {
  TrainSettings standard, given = settings;
  const auto defaults = bind_fields(standard, train_fields()), fields = bind_fields(given, train_fields());
  std::vector<std::string> assignments;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const std::string text = field_text(fields[i]);
    if ((fields[i].uses & kOfKernels) && text != field_text(defaults[i]))
      assignments.push_back(fmt::format("{}={}", fields[i].key, text));
  }
  return assignments;
}

// On CPUs, waiting takes less than a hundredth of a step, and a host thread that does not wait would compete
// with the kernels for the cores (docs/results/2026-11-20-lists.md). On GPUs, waiting would leave the device
// without work until the host has enqueued the next operations.
bool lists_uncounted(const TrainSettings& settings, const DeviceInfo& device) {
  return settings.list_counts == ListCounts::bound ||
         (settings.list_counts == ListCounts::automatic && device.type != DeviceType::cpu);
}

MemoryQuestion memory_question(const TrainSettings& settings, const Split& train, const Split& test,
                               const DeviceInfo& device, std::size_t splats) {
  const ParameterLayout layout(settings.dim, settings.variant);
  MemoryQuestion question{
      .dim = settings.dim,
      .variant = layout.variant,
      .trained_rows = trained_rows(layout, frozen_groups(layout, settings.freeze)),
      .splats = splats,
      .views = train.views.size() + test.views.size(),
      .loss_rows = static_cast<std::size_t>(settings.batch) * static_cast<std::size_t>(settings.log_every),
      .learns_sky = settings.background.learnt != Background::Learnt::no,
      .appearances = settings.appearance == Appearance::none ? 0 : train.views.size(),
      .raster = raster_kind(settings.raster, device),
      .sorts_by_copying = device.sorts_by_copying,
      .compute_units = device.compute_units};
  std::uint64_t largest = 0;  // bytes of the largest image
  for (const Split* split : {&train, &test})
    for (const View& view : split->views) {
      const Camera& camera = view.camera;
      const std::uint64_t bytes = view.image_bytes();
      question.target_bytes += bytes;
      largest = std::max(largest, bytes);
      if (ImageShape{camera.width, camera.height}.plane() >
          ImageShape{question.width, question.height}.plane()) {
        question.width = camera.width;
        question.height = camera.height;
      }
    }
  if (question.target_bytes > kTargetBudgetBytes)
    question.target_bytes = kTargetBudgetBytes + 2 * largest;  // plus two staging buffers
  return question;
}

}  // namespace ubs
