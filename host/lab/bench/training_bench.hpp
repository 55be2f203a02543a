// SPDX-License-Identifier: Apache-2.0
// Times of training as a user has it: whole iterations of the trainer with all of their host work.
#pragma once

#include "host/lab/bench/step_bench.hpp"
#include "host/train/trainer.hpp"

namespace ubs::bench {

struct IterationMeasurement {
  Measured time;  // of one iteration
  std::uint64_t peak_bytes = 0, predicted_bytes = 0;
  std::uint64_t intersections = 0;  // of the last view
};

struct IterationOptions {
  RasterKind raster = RasterKind::cpu;
  bool guard = true;  // as in training: Adam watches for values that are not finite
  ListCounts list_counts{};
  SamplingLimits limits;
  TrainSettings work;  // of which only kernel_assignments() are taken
};

// Learning rates are (almost) zero, so that the scene stays what it is; everything else is as in training:
// upload of rates, regularisation, refinement every 100 iterations, the loss read back after every fifth
// iteration, which ends a sample. A median does not see the refinements, which cost about 1 % on average.
IterationMeasurement measure_iterations(Device& device, const BenchScene& scene,
                                        const IterationOptions& options);

}  // namespace ubs::bench
