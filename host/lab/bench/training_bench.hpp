// SPDX-License-Identifier: Apache-2.0
// measure_iterations() measures the time of whole training iterations, including all work on the host. This
// is the time that a user sees in `ubs train`.
#pragma once

#include "host/lab/bench/step_bench.hpp"
#include "host/train/trainer.hpp"

namespace ubs::bench {

struct IterationMeasurement {
  Measured time;  // time of one iteration
  std::uint64_t peak_bytes = 0, predicted_bytes = 0;
  std::uint64_t intersections = 0;  // in the last view
};

struct IterationOptions {
  RasterKind raster = RasterKind::cpu;
  // If this is true, the Adam step checks for values that are not finite, as it does by default in training.
  bool guard = true;
  ListCounts list_counts{};
  SamplingLimits limits;
  TrainSettings work;  // only kernel_assignments() are used
};

// Measures the time per iteration of a Trainer. Its learning rates are 0 or almost 0, so that the scene does
// not change. The other work is that of a training run: it includes the upload of rates, regularisation,
// refinement every 100 iterations (unless parameter groups are frozen), and reading the loss after every
// fifth iteration, which ends a sample. The median does not include the refinements, which cost about 1 % on
// average.
IterationMeasurement measure_iterations(Device& device, const BenchScene& scene,
                                        const IterationOptions& options);

}  // namespace ubs::bench
