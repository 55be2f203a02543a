// SPDX-License-Identifier: Apache-2.0
#include "host/train/learnt_sky.hpp"

#include "host/base/error.hpp"

namespace ubs {

LearntSky::LearntSky(Device& device, const TrainSettings& settings, ViewPasses& passes, std::uint64_t batch)
    : device_(device),
      passes_(passes),
      batch_(batch),
      harmonics_(settings.background.learnt == Background::Learnt::sky) {
  if (settings.background.learnt == Background::Learnt::no) return;
  gradients_ = Buffer<float>(device, "sky gradients", batch * kSkyNumbers);
  passes.renderer().set_sky(passes.settings().sky.value());
}

void LearntSky::clear() {
  if (gradients_) gradients_.zero();
}

void LearntSky::add_gradient(std::uint64_t draw) {
  if (gradients_)
    passes_.renderer().sky_gradient(gradients_.view(),
                                    static_cast<std::uint32_t>(draw % batch_) * kSkyNumbers);
}

void LearntSky::step(Stages& stages, int iteration, double rate, BufferView<std::uint32_t> sentinel) {
  if (!gradients_) return;
  passes_.merge(gradients_.view(), kSkyNumbers);
  stages.sky_step({.state = passes_.renderer().sky(),
                   .gradient = gradients_.view(),
                   .views = static_cast<std::uint32_t>(batch_),
                   .rate = static_cast<float>(rate),
                   .rate_harmonics = harmonics_ ? static_cast<float>(rate) : 0,
                   .step = static_cast<std::uint64_t>(iteration),
                   .sentinel = sentinel,
                   .stamp = static_cast<std::uint32_t>(iteration)});
}

std::vector<float> LearntSky::state() const {
  return gradients_ ? read_values(device_, passes_.renderer().sky(), kSkyState) : std::vector<float>{};
}

void LearntSky::load(std::span<const float> state) {
  if (state.size() != (gradients_ ? kSkyState : 0))
    fail(ErrorKind::internal,
         "the state of the learnt background has {} numbers, which does not match the settings",
         state.size());
  if (gradients_) passes_.renderer().set_sky(passes_.settings().sky.value(), state);
}

}  // namespace ubs
