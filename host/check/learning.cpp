// SPDX-License-Identifier: Apache-2.0
#include "host/oracle/learning.hpp"

#include <cmath>

#include "host/check/stage_checks.hpp"
#include "kernels/layout.h"

namespace ubs::check {
namespace {

// Worst seen, and why there is room above it: docs/check.md.
constexpr double kGradientBound = 1e-4;
constexpr double kParameterBound = 4.4e-7, kMoment1Bound = 3.4e-7, kMoment2Bound = 3.6e-7,
                 kPenaltyBound = 1.1e-7;  // those of tests/stages/optimiser_test.cpp
constexpr float kOpacityWeight = 5, kScaleWeight = 7, kRate = 1e-3f;
constexpr std::uint64_t kStep = 3;  // both bias corrections matter

struct State {
  std::vector<float> params, moment1, moment2;
};

// Parameters and moments of a model on the device, and steps of them.
class Steps {
 public:
  Steps(Device& device, accuracy::StageRun& run, const Expected& e)
      : device_(device),
        stages_(run.stages()),
        gradient_(run.given_to_projection(e.stages)),
        size_(static_cast<std::size_t>(run.model().rows()) * run.model().stride()),
        moment1_(device, "first moments", size_),
        moment2_(device, "second moments", size_),
        v_params_(device, "parameter gradients", size_),
        rates_(device, "learning rates", static_cast<std::size_t>(run.model().rows())) {
    moment1_.zero();
    moment2_.zero();
    rates_.upload(std::vector<float>(rates_.size(), kRate));
  }

  const SplatView& splats() const { return gradient_.splats; }
  State state() const {
    State s{std::vector<float>(size_), moment1_.download(), moment2_.download()};
    device_.read(*gradient_.splats.params.memory, 0, std::as_writable_bytes(std::span(s.params)));
    return s;
  }
  void restore(const State& s) {
    device_.write(*gradient_.splats.params.memory, 0, std::as_bytes(std::span(s.params)));
    moment1_.upload(s.moment1);
    moment2_.upload(s.moment2);
  }
  Regularise penalty() const { return {splats(), v_params_.view(), kOpacityWeight, kScaleWeight}; }
  AdamStep adam(std::uint64_t step) const {
    return {.splats = splats(),
            .v_params = v_params_.view(),
            .moment1 = moment1_.view(),
            .moment2 = moment2_.view(),
            .learning_rates = rates_.view(),
            .step = step};
  }
  void learn(std::uint64_t step) {
    ProjectBackward gradient = gradient_;
    gradient.v_params = v_params_.view();
    stages_.learn({gradient, penalty(), adam(step)});
  }
  // A step whose only gradient is that of the penalties.
  void learn_nothing(std::uint64_t step) {
    device_.fill_zero(*gradient_.v_records.memory, 0, sizeof(float) * kGradStride * splats().count);
    learn(step);
  }
  Buffer<float>& v_params() { return v_params_; }

 private:
  Device& device_;
  Stages& stages_;
  ProjectBackward gradient_;
  std::size_t size_;
  Buffer<float> moment1_, moment2_, v_params_, rates_;
};

// Of splat i in row k.
double penalty_of(const ParameterLayout& layout, int k, double raw, std::size_t count) {
  if (k == layout.opacity) return oracle::opacity_penalty(raw, kOpacityWeight, count);
  if (k >= layout.scale && k < layout.scale + 3) return oracle::scale_penalty(raw, kScaleWeight, count);
  return 0;
}

struct Place {
  int row;
  std::size_t splat, at, packed;  // in rows of the stride, of the count
};
template <class F>
void for_values(const ParameterLayout& layout, const SplatView& splats, const F& f) {
  for (int k = 0; k < layout.count; ++k)
    for (std::size_t i = 0; i < splats.count; ++i)
      f(Place{k, i, static_cast<std::size_t>(k) * splats.stride + i,
              static_cast<std::size_t>(k) * splats.count + i});
}

void add_step(Worst& worst, const State& after, std::size_t at, const oracle::AdamValue& expected) {
  worst.add("parameter",
            std::abs(after.params[at] - expected.parameter) / (std::abs(expected.parameter) + 0.1),
            kParameterBound);
  worst.add("first moment",
            std::abs(after.moment1[at] - expected.moment1) / (std::abs(expected.moment1) + 0.01),
            kMoment1Bound);
  worst.add("second moment",
            std::abs(after.moment2[at] - expected.moment2) / (std::abs(expected.moment2) + 1e-12),
            kMoment2Bound);
}

// From moments of zero a step leaves a tenth of the gradient in the first one.
Finding check_gradient(const ParameterLayout& layout, const SplatView& splats, const State& before,
                       const State& after, const Expected& e) {
  std::vector<float> found(e.stages.v_params.size());
  std::vector<double> expected(found.size());
  for_values(layout, splats, [&](const Place& p) {
    found[p.packed] = static_cast<float>(after.moment1[p.at] / (1 - static_cast<double>(0.9f)));
    expected[p.packed] =
        e.stages.v_params[p.packed] + penalty_of(layout, p.row, before.params[p.at], splats.count);
  });
  Worst worst("gradient of a step in one pass");
  for (const accuracy::NamedErrors& group : accuracy::group_errors(layout, splats.count, found, expected))
    worst.add(group.quantity, group.errors.relative, kGradientBound);
  return worst.finding();
}

}  // namespace

Findings check_learning(Device& device, accuracy::StageRun& run, const Expected& e) {
  Steps steps(device, run, e);
  const ParameterLayout layout = run.model().layout();
  const SplatView& splats = steps.splats();
  const State start = steps.state();
  steps.learn(1);
  const Finding gradient = check_gradient(layout, splats, start, steps.state(), e);

  // Moments and a gradient of like sizes, so that each term of a step counts.
  State moved = start;
  std::vector<float> v(start.params.size(), 0.0f);
  for_values(layout, splats, [&](const Place& p) {
    const float phase = static_cast<float>(p.packed);
    v[p.at] = 0.1f * std::sin(0.7f * phase);
    moved.moment1[p.at] = 0.1f * std::sin(0.3f * phase);
    moved.moment2[p.at] = 0.01f * (1.1f + std::sin(0.2f * phase));
  });
  const auto before = [&](std::size_t at) {
    return oracle::AdamValue{moved.params[at], moved.moment1[at], moved.moment2[at]};
  };
  Worst once("Adam in one pass"), apart("Adam"), penalties("penalties");
  steps.restore(moved);
  steps.learn_nothing(kStep);
  const State learnt = steps.state();
  steps.restore(moved);
  steps.v_params().upload(v);
  run.stages().regularise(steps.penalty());
  const std::vector<float> penalised = steps.v_params().download();
  run.stages().adam(steps.adam(kStep));
  const State stepped = steps.state();
  for_values(layout, splats, [&](const Place& p) {
    const double penalty = penalty_of(layout, p.row, moved.params[p.at], splats.count);
    add_step(once, learnt, p.at, oracle::adam(before(p.at), penalty, kRate, kStep));
    penalties.add("gradient",
                  std::abs(penalised[p.at] - (v[p.at] + penalty)) / (std::abs(v[p.at] + penalty) + 0.01),
                  kPenaltyBound);
    add_step(apart, stepped, p.at, oracle::adam(before(p.at), penalised[p.at], kRate, kStep));
  });
  steps.restore(start);
  return {gradient, once.finding(), penalties.finding(), apart.finding()};
}

}  // namespace ubs::check
