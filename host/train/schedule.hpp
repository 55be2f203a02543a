// SPDX-License-Identifier: Apache-2.0
// What happens at which iteration of a run: refinements, the number of splats, learning rates, noise
// (method.md 4.2 to 4.4). All of it follows from the share of the work that is done
// (host/train/work_share.hpp), a pure function of the settings. Iterations count from 1; the settings'
// numbers are those of a run of kScheduleLength and scale.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/train/work_share.hpp"

namespace ubs {

class Schedule {
 public:
  // Rates need settings without auto (resolve_automatic). `initial`: splats at the start, which cap_max does
  // not take away. `extent`: of the scene, of which positions' rates are a share.
  Schedule(TrainSettings settings, std::size_t initial, double extent = 1);

  Schedule with(TrainSettings settings) const { return {std::move(settings), initial_, extent_}; }
  const TrainSettings& settings() const { return s_; }
  double extent() const { return extent_; }
  const WorkShare& work() const { return work_; }
  bool refines(int iteration) const;
  bool ever_refines_by(int iteration) const { return first_ < stop_ && iteration >= first_; }
  bool regularises(int iteration) const { return iteration > first_ && iteration < stop_; }

  // Splats after a refinement of so many at an iteration, and after this share of the work where every
  // refinement adds what it may.
  std::uint32_t grown(std::uint32_t splats, int iteration) const;
  std::uint32_t splats_at(double share) const;

  // Of every parameter row.
  std::vector<float> learning_rates(const ParameterLayout& layout, int iteration) const;
  // Of one image of `images`; of 1: of what all of them share, the sky.
  double appearance_rate(int iteration, std::size_t images) const;
  // The share of the sweeps over cameras that came before, where the iteration ends with one.
  std::optional<double> camera_sweep(int iteration) const;
  // The shares at which cameras are swept, rising.
  static std::vector<double> camera_sweep_shares();
  float noise(int iteration) const;

 private:
  std::uint32_t grown(std::uint32_t splats) const;
  double scaled(int iteration) const;    // from kScheduleLength to the steps of the run
  double cooldown(int iteration) const;  // factor of all learning rates
  double lr_xyz(int iteration) const;    // without it

  TrainSettings s_;
  WorkShare work_;
  double extent_;
  std::uint32_t initial_;
  int first_, stop_;  // iterations
  int every_;         // steps of work_
};

}  // namespace ubs
