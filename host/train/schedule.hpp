// SPDX-License-Identifier: Apache-2.0
// Schedule determines what happens at which iteration of a run: refinements, the number of splats, learning
// rates and noise (method.md 4.2 to 4.4). Everything follows from the share of the work that is done
// (host/train/work_share.hpp), which is a pure function of the settings. Iterations are counted from 1.
// Iteration numbers in the settings refer to a run of kScheduleLength iterations and are scaled to the actual
// length.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/train/work_share.hpp"

namespace ubs {

class Schedule {
 public:
  // learning_rates() and noise() need settings without auto (resolve_automatic). `initial` is the number of
  // splats at the start; it is kept even if it exceeds cap_max. The learning rate of positions is multiplied
  // by `extent`, the scene extent.
  Schedule(TrainSettings settings, std::size_t initial, double extent = 1);

  Schedule with(TrainSettings settings) const { return {std::move(settings), initial_, extent_}; }
  const TrainSettings& settings() const { return s_; }
  double extent() const { return extent_; }
  const WorkShare& work() const { return work_; }
  bool refines(int iteration) const;
  bool ever_refines_by(int iteration) const { return first_ < stop_ && iteration >= first_; }
  bool regularises(int iteration) const { return iteration > first_ && iteration < stop_; }

  // grown() returns the number of splats after a refinement at `iteration` that starts with `splats` splats.
  // splats_at() returns the number after a share of the work, if every refinement adds as many splats as it
  // may.
  std::uint32_t grown(std::uint32_t splats, int iteration) const;
  std::uint32_t splats_at(double share) const;

  // Returns the learning rate of every parameter row.
  std::vector<float> learning_rates(const ParameterLayout& layout, int iteration) const;
  // Returns the learning rate for the appearance of one image out of `images`. With 1 it is the rate for
  // parameters that all images share, which are those of the sky.
  double appearance_rate(int iteration, std::size_t images) const;
  // If the iteration ends with a camera sweep, returns the share of all sweeps that precede it.
  std::optional<double> camera_sweep(int iteration) const;
  // Returns the shares of the work at which cameras are swept, in ascending order.
  static std::vector<double> camera_sweep_shares();
  float noise(int iteration) const;

 private:
  std::uint32_t grown(std::uint32_t splats) const;
  double scaled(int iteration) const;    // converts from a run of kScheduleLength to the steps of this run
  double cooldown(int iteration) const;  // factor for all learning rates
  double lr_xyz(int iteration) const;    // learning rate of positions, without the cooldown

  TrainSettings s_;
  WorkShare work_;
  double extent_;
  std::uint32_t initial_;
  int first_, stop_;  // iterations
  int every_;         // in steps of work_
};

}  // namespace ubs
