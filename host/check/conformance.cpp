// SPDX-License-Identifier: Apache-2.0
#include "host/check/conformance.hpp"

#include <algorithm>
#include <bit>
#include <iterator>
#include <map>

#include "host/check/forms.hpp"
#include "host/check/stage_checks.hpp"
#include "host/device/registry.hpp"

namespace ubs::check {
namespace {

// Maximum relative errors (2-norms). docs/check.md links to the largest errors that were measured, and to the
// reasons for these bounds.
constexpr double kProjection = 1e-4, kForward = 1e-5, kBackward = 1e-4, kProjectBackward = 1e-4,
                 kImage = 1e-4, kGradient = 1e-3;

void append(Findings& all, Findings more) { std::ranges::move(more, std::back_inserter(all)); }

// Adds a finding for each entry of StageRun::stage_errors(). `shown` maps the name of a stage to the name
// that is displayed and to the bound for its errors.
void add_stages(Findings& all, const std::vector<StageErrors>& stages) {
  const std::map<std::string, std::pair<const char*, double>> shown{
      {"project_forward", {"projection", kProjection}},
      {"lists + raster_forward", {"rasteriser", kForward}},
      {"raster_backward", {"backward rasteriser", kBackward}},
      {"project_backward", {"backward projection", kProjectBackward}}};
  for (const StageErrors& stage : stages) {
    const auto found = shown.find(stage.stage);
    if (found == shown.end()) continue;  // the loss is checked separately
    WorstFinding worst(found->second.first);
    for (const NamedErrors& q : stage.quantities)
      worst.add(q.quantity, q.errors.relative, found->second.second);
    all.push_back(worst.finding());
  }
}

Finding check_image(const StageRun& run, const FormVectors& e) {
  ErrorSum sum;
  sum.add(run.image(), e.truth.image, e.problem.undecided);
  WorstFinding worst("image");
  worst.add("image", sum.errors().relative, kImage);
  return worst.finding();
}

Finding check_gradient(StageRun& run, const FormVectors& e) {
  WorstFinding worst("gradient");
  const SplatModel& model = e.problem.model;
  for (const NamedErrors& group :
       group_errors(model.layout(), model.count, run.gradient_of(e.truth.v_image), e.truth.v_params))
    worst.add(group.quantity, group.errors.relative, kGradient);
  return worst.finding();
}

// Returns the number of values that are not bit-identical. So a NaN counts as equal to the same NaN, and
// zeros with different signs count as different.
double differing(const std::vector<float>& a, const std::vector<float>& b) {
  double count = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    count += std::bit_cast<std::uint32_t>(a[i]) != std::bit_cast<std::uint32_t>(b[i]);
  return count;
}

Finding check_repeats(StageRun& run, bool backward) {
  const char* operation = backward ? "iteration" : "forward";
  WorstFinding worst("reproducibility");
  run.run(operation);
  const std::vector<float> image = run.image(), gradient = backward ? run.gradient() : std::vector<float>{};
  run.run(operation);
  worst.add("image values that differ", differing(image, run.image()), 0);
  if (backward) worst.add("gradient values that differ", differing(gradient, run.gradient()), 0);
  return worst.finding();
}

Findings examine_scene(Device& device, const KernelConfig& config, const Subject& subject) {
  const FormVectors& e = embedded_vectors().forms[nearest_form(form_of(config))];
  const auto has = [&](Part part) { return std::ranges::count(subject.parts, part) > 0; };
  StageRun run(device, config, e.problem);
  Findings all;
  append(all, check_lists(device, run.stages()));
  add_stages(all, run.stage_errors(e.truth));
  if (has(Part::loss)) append(all, check_loss(device, run.stages()));
  all.push_back(check_image(run, e));
  if (config.backward) all.push_back(check_gradient(run, e));
  all.push_back(check_repeats(run, config.backward));
  if (has(Part::learning)) {
    append(all, check_learning(device, run, e));
    append(all, check_population(device, run.stages(), e));
  }
  return all;
}

}  // namespace

Findings examine(Device& device, const Subject& subject) {
  const auto has = [&](Part part) { return std::ranges::count(subject.parts, part) > 0; };
  const KernelConfig config = checked_config(subject.config);
  Findings all;
  if (has(Part::drawing)) {
    append(all, examine_scene(device, config, subject));
  } else if (has(Part::loss)) {
    append(all, check_loss(device, *make_stages(device, config)));
  }
  if (has(Part::networks)) append(all, check_networks(device));
  return all;
}

const Finding* failure(const Findings& findings) {
  const auto found = std::ranges::find_if(findings, [](const Finding& f) { return !f.holds(); });
  return found == findings.end() ? nullptr : &*found;
}

}  // namespace ubs::check
