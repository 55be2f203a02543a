// SPDX-License-Identifier: Apache-2.0
// Error of single precision against stiffness (`ubs sweep`, docs/stability-sweeps.md). Each sweep varies one
// stiff quantity over its whole range; at every point a set of random splats goes through the projection
// kernels and the blending formulas of the product ("safe") and through their textbook evaluation ("naive",
// kernels/naive), values and gradients, and both are compared with a reference in extended precision built
// from the oracle's formulas.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/data/image.hpp"
#include "host/device/device.hpp"

namespace ubs::stress {

// Relative 2-norm errors at one point: of the values (colours at 64 points of each splat) and of the gradient
// in the worst of its parameter groups (xyz, rgb, opacity, ...). Infinite when something is not finite.
struct SweepErrors {
  double value = 0, gradient = 0;              // over all splats together
  double worst_value = 0, worst_gradient = 0;  // of one splat; 1 for a cull that the reference does not share
  std::string group;                           // of `gradient`
  int disagreed = 0;                           // drawn here and not there
};

struct SweepPoint {
  double x = 0;                // the stiff quantity
  int splats = 0, culled = 0;  // culled in the reference
  SweepErrors safe, naive;
  SweepErrors half_ulp;  // what half an ulp of every parameter does to the exact result: no evaluation that
                         // reads single-precision parameters can be expected to be better
};

struct SweepResult {
  std::string name, title, x_label;
  std::vector<SweepPoint> points;
  bool has_naive =
      true;  // else `naive` of its points is empty: the textbook form is that of the default variant
};

// Nanoseconds, least of several repetitions; per splat (projection, N = 7) and per splat and point
// (blending).
struct SweepTimes {
  double project_forward[2], project_backward[2], blend[2];  // safe, naive
};

struct SweepOptions {
  std::vector<std::string> names;  // empty: all
  int points = 0;                  // a sweep; 0: as many as the sweep has by default
  int splats = 32;                 // a point
  std::uint64_t seed = 1;
  std::function<void(const SweepResult&)> on_result;
};

std::vector<std::string> sweep_names();
// Needs an OpenCL device: the naive kernels are compiled at run time. Throws Error(device) for others,
// Error(usage) for names that do not exist.
std::vector<SweepResult> run_sweeps(Device& device, const SweepOptions& options);
SweepTimes time_formulations(Device& device);

std::string sweep_csv(const std::vector<SweepResult>& results);
// One line a sweep: range, worst errors of each formulation, and up to where each stays within 1e-3.
std::string sweep_text(const std::vector<SweepResult>& results);
// Largest x up to which all points are within `bound` in value and gradient; 0 when none is.
double reach_of(const SweepResult& result, const SweepErrors SweepPoint::*which, double bound);
// Error against stiffness, one panel a sweep, log-log.
Image8 sweep_plot(const std::vector<SweepResult>& results);

}  // namespace ubs::stress
