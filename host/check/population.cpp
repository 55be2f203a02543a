// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "host/base/random.hpp"
#include "host/check/copied_splats.hpp"
#include "host/check/stage_checks.hpp"
#include "host/pipeline/device_model.hpp"

namespace ubs::check {
namespace {

constexpr float kDead = -8;  // raw opacity of dead splats
// Maximum relative error of opacities. The largest error in tests/stages/mcmc_test.cpp was 2.4e-7. But OpenCL
// allows errors of 3 ulp for exp, log and division. Raw opacities are as large as 5, so an error of 3 ulp of
// such a logarithm is 1.4e-6, and the total error can be 1.8e-6. The bound is twice that.
constexpr double kOpacityBound = 3.6e-6;
// Bound for the positions after noise was added. It is that of tests/stages/mcmc_test.cpp, where the largest
// error was 8.5e-6.
constexpr double kNoiseBound = 1.7e-5;

// Bound for the other parameters of copies. The largest error in tests/stages/mcmc_test.cpp was 1.8e-7, but
// the same errors of 3 ulp as for opacities are allowed.
constexpr double kCopyBound = 3.6e-6;

class PopulationOnDevice {
 public:
  PopulationOnDevice(Device& device, const Population& population)
      : before_(population),
        params_(device, "params", population.params.size()),
        moment1_(device, "first moments", population.params.size()),
        moment2_(device, "second moments", population.params.size()) {
    params_.upload(population.params);
    moment1_.upload(population.moment1);
    moment2_.upload(population.moment2);
  }
  std::uint32_t relocate(Stages& stages) {
    return stages.relocate({splats(), moment1_.view(), moment2_.view(), kDrawSeed, kDrawIteration});
  }
  void grow(Stages& stages, std::uint32_t target) {
    stages.grow({splats(), target, moment1_.view(), moment2_.view(), kDrawSeed, kDrawIteration});
  }
  Population download() const {
    Population after = before_;
    params_.download(std::span<float>(after.params));
    moment1_.download(std::span<float>(after.moment1));
    moment2_.download(std::span<float>(after.moment2));
    return after;
  }

 private:
  SplatView splats() const { return {params_.view(), before_.count, before_.stride}; }
  const Population& before_;
  Buffer<float> params_, moment1_, moment2_;
};

void add_copies(WorstFinding& worst, const Population& before, const Population& after,
                const std::vector<std::uint32_t>& written) {
  const Copies copies = judge_copies(before, after, written);
  if (!copies.problem.empty()) worst.refuse(copies.problem);
  worst.add("opacity of copied splats", copies.opacity_error, kOpacityBound);
}

Finding check_relocation(Device& device, Stages& stages, const ParameterLayout& layout) {
  Population population(layout, 500, 500, 0);
  Random random(4);
  std::vector<std::uint32_t> dead;
  for (std::uint32_t i = 0; i < population.count; ++i) {
    population.at(population.opacity_row, i) =
        i % 3 == 1 ? kDead : static_cast<float>(std::max(-5.0, 2 * random.normal()));
    if (i % 3 == 1) dead.push_back(i);
  }
  PopulationOnDevice on(device, population);
  WorstFinding worst("relocation");
  worst.add("number of moved splats",
            std::abs(static_cast<double>(on.relocate(stages)) - static_cast<double>(dead.size())), 0);
  add_copies(worst, population, on.download(), dead);
  return worst.finding();
}

Finding check_growth(Device& device, Stages& stages, const ParameterLayout& layout) {
  Population population(layout, 1000, 1100, 0.5f);
  PopulationOnDevice on(device, population);
  on.grow(stages, 1088);
  std::vector<std::uint32_t> slots;
  for (std::uint32_t i = population.count; i < 1088; ++i) slots.push_back(i);
  WorstFinding worst("growth");
  add_copies(worst, population, on.download(), slots);
  return worst.finding();
}

// Checks that relocation chooses the splats to copy (sources) with a probability proportional to their
// opacity. The measure is chi-square with 49 degrees of freedom.
Finding check_draw(Device& device, Stages& stages, const ParameterLayout& layout) {
  constexpr std::uint32_t kSources = 50, kDraws = 20000;
  Population population(layout, kSources + kDraws, kSources + kDraws, kDead);
  double total = 0;
  for (std::uint32_t i = 0; i < kSources; ++i) {
    population.at(population.opacity_row, i) = -4.0f + 0.16f * static_cast<float>(i);
    total += population.opacity(i);
  }
  PopulationOnDevice on(device, population);
  on.relocate(stages);
  const Population after = on.download();
  std::vector<double> drawn(kSources, 0);
  for (std::uint32_t i = kSources; i < population.count; ++i)
    if (const float from = after.at(0, i); from >= 0 && from < kSources) ++drawn[after.origin(i)];
  double chi_square = 0;
  for (std::uint32_t i = 0; i < kSources; ++i) {
    const double expected = kDraws * population.opacity(i) / total;
    chi_square += (drawn[i] - expected) * (drawn[i] - expected) / expected;
  }
  WorstFinding worst("choice of sources");
  // A correct device exceeds this bound with a probability of 1e-4. As the seed is fixed, the result of a
  // device is always the same.
  worst.add("chi-square", chi_square, 94);
  return worst.finding();
}

Finding check_noise(Device& device, Stages& stages, const FormVectors& e) {
  SplatModel model = e.problem.model;
  for (float& raw : model.row(model.layout().opacity)) raw += kNoiseOpacity;
  const DeviceModel on(device, model);
  stages.add_noise({on.view(), static_cast<float>(kNoiseAmount), kDrawSeed, kDrawIteration});
  const SplatModel after = on.download();
  WorstFinding worst("noise");
  double moved = 0;
  for (std::size_t i = 0; i < model.count; ++i) {
    for (int r = 0; r < 3; ++r) {
      const std::size_t at = static_cast<std::size_t>(r) * model.count + i;
      const double expected = model.row(r)[i] + e.displacement[at];
      worst.add("position", std::abs(after.row(r)[i] - expected) / (1 + 3 * e.displacement_size[at]),
                kNoiseBound);
    }
    for (int r = 3; r < model.layout().count; ++r) moved += after.row(r)[i] != model.row(r)[i];
  }
  worst.add("parameters changed by noise", moved, 0);
  return worst.finding();
}

Finding check_places(Device& device, Stages& stages, const FormVectors& e) {
  const SplatModel& model = e.problem.model;
  const DeviceModel on(device, model);
  const std::vector<std::uint32_t> ones(model.count, 1);
  Buffer<std::uint32_t> counts(device, "copies", ones.size());
  counts.upload(ones);
  Buffer<float> moment1(device, "first moments", on.params().size()),
      moment2(device, "second moments", on.params().size());
  stages.split_sources({on.view(), counts.view(), moment1.view(), moment2.view(), kCopySpread});
  stages.place_copies({.splats = on.view(),
                       .slots = on.count(),
                       .sources = counts.view(),
                       .spread = kCopySpread,
                       .purpose = kDrawGrow,
                       .seed = kDrawSeed,
                       .iteration = kDrawIteration});
  const SplatModel after = on.download();
  WorstFinding worst("places and sizes of copies");
  for (int r = 0; r < model.layout().count; ++r)
    for (std::size_t i = 0; i < model.count; ++i) {
      const std::size_t at = static_cast<std::size_t>(r) * model.count + i;
      const double error = std::abs(after.row(r)[i] - e.copies[at]);
      if (r < 3)
        worst.add("position", error / (1 + 3 * e.copy_size[at]), kNoiseBound);
      else
        worst.add("parameter", error / (1 + std::abs(e.copies[at])), kCopyBound);
    }
  return worst.finding();
}

}  // namespace

Findings check_population(Device& device, Stages& stages, const FormVectors& e) {
  const ParameterLayout layout(stages.config().dim, stages.config().variant);
  return {check_relocation(device, stages, layout), check_growth(device, stages, layout),
          check_draw(device, stages, layout), check_noise(device, stages, e),
          check_places(device, stages, e)};
}

}  // namespace ubs::check
