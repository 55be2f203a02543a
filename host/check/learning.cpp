// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "host/check/stage_checks.hpp"
#include "kernels/layout.h"

namespace ubs::check {
namespace {

// Maximum relative error of the gradient. docs/check.md links to the largest errors that were measured, and
// to the reasons for the bounds.
constexpr double kGradientBound = 1e-4;
// Bounds for an Adam step. They are those of tests/stages/optimiser_test.cpp.
constexpr double kParameterBound = 4.4e-7, kMoment1Bound = 3.4e-7, kMoment2Bound = 3.6e-7;
// The largest errors that were measured are 9.5e-8 on CPUs and 1.26e-7 on an H100. The bound is larger,
// because GPUs may compute exponentials and divisions with an error of 3 ulp each.
constexpr double kPenaltyBound = 1e-6;

struct State {
  std::vector<float> params, moment1, moment2;
};

// Steps holds the parameters and moments of a model on the device, and runs optimiser steps on them.
class Steps {
 public:
  Steps(Device& device, StageRun& run, const FormVectors& e)
      : device_(device),
        stages_(run.stages()),
        gradient_(run.given_to_projection(e.truth)),
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
  Regularise penalty(bool any = true) const {
    PenaltyWeights weights{};
    auto& [opacity, scale] = weights;  // all terms: this does not compile when one is added
    opacity = any ? kOpacityWeight : 0;
    scale = any ? kScaleWeight : 0;
    return {splats(), v_params_.view(), weights};
  }
  AdamStep adam(std::uint64_t step) const {
    return {.splats = splats(),
            .v_params = v_params_.view(),
            .moment1 = moment1_.view(),
            .moment2 = moment2_.view(),
            .learning_rates = rates_.view(),
            .step = step};
  }
  void learn(std::uint64_t step, bool penalised) {
    ProjectBackward gradient = gradient_;
    gradient.v_params = v_params_.view();
    stages_.learn({gradient, penalty(penalised), adam(step)});
  }
  // Runs a step whose gradient is 0.
  void learn_nothing(std::uint64_t step) {
    device_.fill_zero(*gradient_.v_records.memory, 0, sizeof(float) * kGradStride * splats().count);
    learn(step, false);
  }
  Buffer<float>& v_params() { return v_params_; }

 private:
  Device& device_;
  Stages& stages_;
  ProjectBackward gradient_;
  std::size_t size_;
  Buffer<float> moment1_, moment2_, v_params_, rates_;
};

// Place is the position of one parameter value of the model.
struct Place {
  int row;
  std::size_t splat;
  std::size_t at, packed;  // index in rows of `stride` values, and in rows of `count` values
  std::size_t adam() const { return packed % kAdamCases; }  // the case of AdamVectors that is stored here
};
// Calls `f` with the Place of every parameter value.
template <class F>
void for_values(const ParameterLayout& layout, const SplatView& splats, const F& f) {
  for (int k = 0; k < layout.count; ++k)
    for (std::size_t i = 0; i < splats.count; ++i)
      f(Place{k, i, static_cast<std::size_t>(k) * splats.stride + i,
              static_cast<std::size_t>(k) * splats.count + i});
}

bool is_scale(const ParameterLayout& layout, int row) {
  return row >= layout.scale && row < layout.scale + 3;
}

// Returns the expected gradient of the penalties for a parameter of the model of `e`. It is 0 for rows
// without a penalty.
double model_penalty(const ParameterLayout& layout, const Place& p, const FormVectors& e) {
  if (p.row == layout.opacity) return e.penalties[p.splat];
  if (!is_scale(layout, p.row)) return 0;
  return e.penalties[static_cast<std::size_t>(1 + p.row - layout.scale) * kSplats + p.splat];
}

// Returns the expected gradient of the penalties if the parameters are those of `cases`.
double case_penalty(const ParameterLayout& layout, const Place& p, const AdamVectors& cases) {
  if (p.row == layout.opacity) return cases.opacity_penalty[p.adam()];
  return is_scale(layout, p.row) ? cases.scale_penalty[p.adam()] : 0;
}

void add_step(WorstFinding& worst, const State& after, std::size_t at, double parameter, double moment1,
              double moment2) {
  worst.add("parameter", std::abs(after.params[at] - parameter) / (std::abs(parameter) + 0.1),
            kParameterBound);
  worst.add("first moment", std::abs(after.moment1[at] - moment1) / (std::abs(moment1) + 0.01),
            kMoment1Bound);
  worst.add("second moment", std::abs(after.moment2[at] - moment2) / (std::abs(moment2) + 1e-12),
            kMoment2Bound);
}

// Compares the gradient of a step with its expected value. The gradient is computed from the first moment,
// because a step that starts with moments of zero sets the first moment to a tenth of the gradient.
Finding check_step_gradient(const ParameterLayout& layout, const SplatView& splats, const State& after,
                            const FormVectors& e) {
  std::vector<float> found(e.truth.v_params.size());
  std::vector<double> expected(found.size());
  for_values(layout, splats, [&](const Place& p) {
    found[p.packed] = static_cast<float>(after.moment1[p.at] / (1 - static_cast<double>(0.9f)));
    expected[p.packed] = e.truth.v_params[p.packed] + model_penalty(layout, p, e);
  });
  WorstFinding worst("parameter gradient in the combined training step");
  for (const NamedErrors& group : group_errors(layout, splats.count, found, expected))
    worst.add(group.quantity, group.errors.relative, kGradientBound);
  return worst.finding();
}

}  // namespace

Findings check_learning(Device& device, StageRun& run, const FormVectors& e) {
  const AdamVectors& cases = embedded_vectors().adam;
  Steps steps(device, run, e);
  const ParameterLayout layout = run.model().layout();
  const SplatView& splats = steps.splats();
  const State start = steps.state();
  steps.learn(1, true);
  const Finding gradient = check_step_gradient(layout, splats, steps.state(), e);

  // For the combined step, only the moments are replaced by those of the test cases. Its parameters must be
  // those of the model, because the step projects the model again.
  State moving = start;
  for_values(layout, splats, [&](const Place& p) {
    moving.moment1[p.at] = static_cast<float>(cases.moment1[p.adam()]);
    moving.moment2[p.at] = static_cast<float>(cases.moment2[p.adam()]);
  });
  steps.restore(moving);
  steps.learn_nothing(kAdamStep);
  const State at_rest = steps.state();
  WorstFinding once("Adam in the combined training step");
  for_values(layout, splats, [&](const Place& p) {
    add_step(once, at_rest, p.at, start.params[p.at] + cases.step_at_rest[p.adam()],
             cases.moment1_at_rest[p.adam()], cases.moment2_at_rest[p.adam()]);
  });

  // The separate operations for penalties and Adam can use the parameters and gradients of the test cases
  // too.
  State given = moving;
  std::vector<float> v(start.params.size(), 0.0f);
  for_values(layout, splats, [&](const Place& p) {
    given.params[p.at] = static_cast<float>(cases.parameter[p.adam()]);
    v[p.at] = static_cast<float>(cases.gradient[p.adam()]);
  });
  steps.restore(given);
  steps.v_params().upload(v);
  run.stages().regularise(steps.penalty());
  const std::vector<float> penalised = steps.v_params().download();
  steps.v_params().upload(v);
  run.stages().adam(steps.adam(kAdamStep));
  const State stepped = steps.state();
  WorstFinding penalties("penalties"), apart("Adam");
  for_values(layout, splats, [&](const Place& p) {
    const double expected = v[p.at] + case_penalty(layout, p, cases);
    penalties.add("gradient", std::abs(penalised[p.at] - expected) / (std::abs(expected) + 0.01),
                  kPenaltyBound);
    add_step(apart, stepped, p.at, cases.new_parameter[p.adam()], cases.new_moment1[p.adam()],
             cases.new_moment2[p.adam()]);
  });
  steps.restore(start);
  return {gradient, once.finding(), penalties.finding(), apart.finding()};
}

}  // namespace ubs::check
