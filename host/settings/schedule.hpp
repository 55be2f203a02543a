// SPDX-License-Identifier: Apache-2.0
// Schedule determines for each iteration of a run whether splats are refined, how many splats there are, the
// learning rates and the noise (method.md 4.2 to 4.4). All of this depends only on the share of the work that
// is done (host/settings/work_share.hpp), which is a function of the settings. Iterations are counted from 1.
// Iteration numbers in the settings refer to a run of kScheduleLength iterations and are scaled to the actual
// length.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "host/scene/splat_model.hpp"
#include "host/settings/work_share.hpp"

namespace ubs {

class Schedule {
 public:
  // `initial` is the number of splats at the start. It is not reduced if it exceeds cap_max. `extent` is the
  // scene extent, by which the learning rate of positions is multiplied. The settings must be those of a
  // plan; the number of splats only depends on the automatic settings cap_max, refine and growth.
  Schedule(TrainSettings settings, std::size_t initial, double extent = 1);

  // Returns a schedule with other settings, but with the same `initial` and `extent`.
  Schedule with(TrainSettings settings) const { return {std::move(settings), initial_, extent_}; }
  const TrainSettings& settings() const { return s_; }
  double extent() const { return extent_; }
  const WorkShare& work() const { return work_; }
  // refines() returns whether splats are relocated and added at the end of this iteration. ever_refines_by()
  // returns whether the part of the run in which splats are refined has started by this iteration.
  // regularises() returns whether the opacity and scale penalties apply in this iteration.
  bool refines(int iteration) const;
  bool ever_refines_by(int iteration) const { return first_ < stop_ && iteration >= first_; }
  bool regularises(int iteration) const { return iteration > first_ && iteration < stop_; }

  // grown() returns the number of splats after a refinement at `iteration` that starts with `splats` splats.
  // splats_at() returns the number of splats after a share of the work, if every refinement adds as many
  // splats as the settings allow.
  std::uint32_t grown(std::uint32_t splats, int iteration) const;
  std::uint32_t splats_at(double share) const;

  // Returns the learning rate of every parameter row.
  std::vector<float> learning_rates(const ParameterLayout& layout, int iteration) const;
  // Returns the learning rate for the appearance of one of `images` images. With `images` = 1, this is the
  // rate for parameters that all images share; it is used for the learnt background.
  double appearance_rate(int iteration, std::size_t images) const;
  // If the iteration ends with a camera sweep, returns the number of earlier sweeps divided by 19. This is 0
  // for the first of the 20 sweeps and 1 for the last. Otherwise returns nothing.
  std::optional<double> camera_sweep(int iteration) const;
  // Returns the shares of the work at which cameras are swept, in ascending order.
  static std::vector<double> camera_sweep_shares();
  // Returns the factor of the position noise.
  float noise(int iteration) const;

 private:
  std::uint32_t grown(std::uint32_t splats) const;
  double scaled(int iteration) const;    // converts an iteration number of the settings to steps of work_
  double cooldown(int iteration) const;  // factor for all learning rates
  double lr_xyz(int iteration) const;    // learning rate of positions, without the cooldown

  TrainSettings s_;
  WorkShare work_;
  double extent_;
  std::uint32_t initial_;
  int first_, stop_;  // iterations between which splats are refined
  int every_;         // interval of refinements, in steps of work_
};

}  // namespace ubs
