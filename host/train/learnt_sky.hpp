// SPDX-License-Identifier: Apache-2.0
// LearntSky is the background of a training where it is learnt: one colour, or a sky of spherical harmonics
// (method.md 4.9). Without it nothing happens here.
#pragma once

#include <span>
#include <vector>

#include "host/scene/train_settings.hpp"
#include "host/train/guard.hpp"
#include "host/train/view_passes.hpp"

namespace ubs {

class LearntSky {
 public:
  LearntSky(Device& device, const TrainSettings& settings, ViewPasses& passes, std::uint64_t batch);

  // For a step: forgets the gradients of the last one, adds that of the view that has been drawn, steps.
  void clear();
  void add_gradient(std::uint64_t draw);
  void step(Stages& stages, int iteration, double rate, BufferView<std::uint32_t> sentinel);

  std::vector<float> state() const;  // of TrainState; empty: not learnt
  void load(std::span<const float> state);

 private:
  Device& device_;
  ViewPasses& passes_;
  const std::uint64_t batch_;
  const bool harmonics_;
  Buffer<float> gradients_;  // (batch, 27), or none: the background is not learnt
};

}  // namespace ubs
