// SPDX-License-Identifier: Apache-2.0
// What happens at which iteration of a run: refinements, the number of splats, learning rates, noise
// (method.md 4.2 to 4.4). A pure function of settings, for training and for whoever predicts it. Iterations
// count from 1; the settings' numbers are those of a run of kScheduleLength and scale.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/train/timeline.hpp"

namespace ubs {

class Schedule {
 public:
  // Rates need settings without auto (resolve_automatic). `initial`: splats at the start, which cap_max does
  // not take away. `extent`: of the scene, of which positions' rates are a share.
  Schedule(TrainSettings settings, std::size_t initial, double extent = 1);

  Schedule with(const TrainSettings& settings) const { return {settings, initial_, extent_}; }
  double extent() const { return extent_; }
  int refine_every() const { return every_; }
  bool refines(int iteration) const { return regularises(iteration) && iteration % every_ == 0; }
  bool ever_refines_by(int iteration) const { return first_ < stop_ && iteration >= first_; }
  bool regularises(int iteration) const { return iteration > first_ && iteration < stop_; }

  // Splats after a refinement of so many, and after an iteration.
  std::uint32_t grown(std::uint32_t splats) const;
  std::uint32_t splats_at(int iteration) const;

  // Of every parameter row.
  std::vector<float> learning_rates(const ParameterLayout& layout, int iteration) const;
  // Of one image of `images`; of 1: of what all of them share, the sky.
  double appearance_rate(int iteration, std::size_t images) const;
  // The share of the sweeps over cameras that came before, where the iteration ends with one.
  std::optional<double> camera_sweep(int iteration) const;
  int camera_sweeps_by(int iteration) const;  // how many, where cameras are refined
  float noise(int iteration) const;

 private:
  int sweep_iteration(double done) const;
  double scaled(int iteration) const;    // from kScheduleLength to the schedule's length
  double cooldown(int iteration) const;  // factor of all learning rates
  double lr_xyz(int iteration) const;    // without it

  TrainSettings s_;
  Timeline time_;
  double extent_;
  std::uint32_t initial_;
  int first_, stop_, every_;
};

}  // namespace ubs
