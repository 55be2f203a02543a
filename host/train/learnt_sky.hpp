// SPDX-License-Identifier: Apache-2.0
// LearntSky optimises the background during training: a single colour, or a sky of spherical harmonics
// (method.md 4.11). If the background is not learnt, the methods of LearntSky do nothing.
#pragma once

#include <span>
#include <vector>

#include "host/settings/train_settings.hpp"
#include "host/train/guard.hpp"
#include "host/train/view_passes.hpp"

namespace ubs {

class LearntSky {
 public:
  LearntSky(Device& device, const TrainSettings& settings, ViewPasses& passes, std::uint64_t batch);

  // These functions are the parts of one step. clear() sets the gradients of the previous step to zero,
  // add_gradient() stores the gradient of the view that was rendered last, and step() updates the background.
  void clear();
  void add_gradient(std::uint64_t draw);
  void step(Stages& stages, int iteration, double rate, BufferView<std::uint32_t> sentinel);

  // state() returns the numbers for TrainState::sky, or nothing if the background is not learnt. load()
  // restores them.
  std::vector<float> state() const;
  void load(std::span<const float> state);

 private:
  Device& device_;
  ViewPasses& passes_;
  const std::uint64_t batch_;
  const bool harmonics_;
  Buffer<float> gradients_;  // (batch, 27); no buffer if the background is not learnt
};

}  // namespace ubs
