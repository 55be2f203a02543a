// SPDX-License-Identifier: Apache-2.0
#include "host/settings/schedule.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace ubs {
namespace {

// The first camera sweep takes place when the model already shows the structure of the scene. After the last
// sweep, the model adapts to the final cameras.
constexpr int kSweeps = 20;
constexpr double kFirstSweep = 0.1, kLastSweep = 0.9;  // shares of the work

// Adam changes a parameter by about its learning rate per step. The initial rate of the appearance of an
// image is chosen so that its gains, which are logarithms, can change by kAppearanceTravel during the run. It
// is limited to the range from kAppearanceRate to kMaxAppearanceRate, so it is 0.1 if the run has at most 60
// steps per image (tests/train/appearance_training_test.cpp), and 0.02 if it has at least 300.
constexpr double kAppearanceTravel = 6, kAppearanceRate = 0.02, kMaxAppearanceRate = 0.1;

}  // namespace

Schedule::Schedule(TrainSettings settings, std::size_t initial, double extent)
    : s_(std::move(settings)),
      work_(s_),
      extent_(extent),
      initial_(static_cast<std::uint32_t>(initial)),
      first_(work_.iteration_at(scaled(s_.refine.first))),
      stop_(work_.iteration_at(scaled(s_.refine.end))),
      every_(std::max(1, static_cast<int>(std::llround(scaled(s_.refine.step))))) {}

double Schedule::scaled(int iteration) const {
  return static_cast<double>(iteration) * work_.steps() / kScheduleLength;
}

bool Schedule::refines(int iteration) const {
  const auto refinements_by = [&](int i) { return std::floor(work_.steps_at(i) / every_); };
  return regularises(iteration) && refinements_by(iteration) > refinements_by(iteration - 1);
}

std::uint32_t Schedule::grown(std::uint32_t splats) const {
  const double cap = std::max(static_cast<double>(s_.cap_max), static_cast<double>(initial_));
  return std::max(
      splats, static_cast<std::uint32_t>(std::min(cap, std::floor(s_.growth * static_cast<double>(splats)))));
}

std::uint32_t Schedule::grown(std::uint32_t splats, int iteration) const {
  return work_.at(iteration) >= s_.growth_end ? splats : grown(splats);
}

std::uint32_t Schedule::splats_at(double share) const {
  constexpr double kRounding = 1e-6;  // steps
  const double first = std::floor(static_cast<double>(scaled(s_.refine.first)) / every_);
  const double end = std::min(
      {share * work_.steps() + kRounding, scaled(s_.refine.end) - kRounding,
       s_.growth_end < 1 ? s_.growth_end * work_.steps() - kRounding : std::numeric_limits<double>::max()});
  std::uint32_t splats = initial_;
  for (double event = first + 1; event * every_ <= end; ++event) {
    const std::uint32_t before = splats;
    if ((splats = grown(before)) == before) break;  // the maximum is reached, or there is no growth
  }
  return splats;
}

double Schedule::cooldown(int iteration) const {
  const double left = 1 - work_.at(iteration), share = s_.lr_cooldown;
  return left < share ? left / share : 1;
}

double Schedule::lr_xyz(int iteration) const {
  const double t = work_.at(iteration);
  return extent_ * std::exp((1 - t) * std::log(s_.lr_xyz) + t * std::log(s_.lr_xyz_final));
}

std::vector<float> Schedule::learning_rates(const ParameterLayout& layout, int iteration) const {
  const std::map<std::string, double> by_group{{"xyz", lr_xyz(iteration)},
                                               {"rgb", s_.lr_rgb},
                                               {"sh0", s_.lr_rgb},
                                               {"lobes", s_.lr_rgb},
                                               {"sh_rest", s_.lr_rgb / 20},
                                               {"opacity", s_.lr_opacity},
                                               {"beta", s_.lr_beta},
                                               {"mean", s_.lr_mean},
                                               {"scale", s_.lr_scale},
                                               {"l_triangle", s_.lr_l_triangle},
                                               {"rotation", s_.lr_l_triangle}};
  const double factor = cooldown(iteration) * (s_.lr_batch == BatchRates::sqrt ? std::sqrt(s_.batch) : 1);
  std::vector<float> rates(static_cast<std::size_t>(layout.count));
  for (const ParameterGroup& group : parameter_groups(layout))
    std::fill_n(rates.begin() + group.first, group.count,
                static_cast<float>(factor * by_group.at(group.name)));
  return rates;
}

double Schedule::appearance_rate(int iteration, std::size_t images) const {
  const double t = work_.at(iteration);
  const double steps = work_.iterations_per_share(iteration) * s_.batch / static_cast<double>(images);
  const double initial = std::clamp(kAppearanceTravel / steps, kAppearanceRate, kMaxAppearanceRate);
  return cooldown(iteration) * initial * std::pow(0.01, t);
}

std::vector<double> Schedule::camera_sweep_shares() {
  std::vector<double> shares;
  for (int k = 0; k < kSweeps; ++k)
    shares.push_back(kFirstSweep + double{1} * k / (kSweeps - 1) * (kLastSweep - kFirstSweep));
  return shares;
}

std::optional<double> Schedule::camera_sweep(int iteration) const {
  const std::vector<double> shares = camera_sweep_shares();
  for (std::size_t k = 0; k < shares.size(); ++k)
    if (work_.iteration_at(shares[k] * work_.steps()) == iteration)
      return static_cast<double>(k) / (kSweeps - 1);
  return {};
}

float Schedule::noise(int iteration) const { return static_cast<float>(s_.noise_lr * lr_xyz(iteration)); }

}  // namespace ubs
