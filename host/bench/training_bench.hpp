// SPDX-License-Identifier: Apache-2.0
// Times of training as a user has it: whole iterations of the trainer with all of their host work, and the
// time that training takes to a given quality.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "host/bench/step_bench.hpp"
#include "host/train/trainer.hpp"

namespace ubs::bench {

struct IterationMeasurement {
  Measured time;  // of one iteration
  std::uint64_t peak_bytes = 0, predicted_bytes = 0;
  std::uint64_t intersections = 0;  // of the last view
};

struct IterationOptions {
  RasterKind raster = RasterKind::cpu;
  int batch = 1;
  bool guard = true;  // as in training: Adam watches for values that are not finite
  ListCounts list_counts{};
  SamplingLimits limits;
  TrainSettings work;  // of which only kernel_assignments() are taken
};

// Learning rates are (almost) zero, so that the scene stays what it is; everything else is as in training:
// upload of rates, regularisation, refinement every 100 iterations, the loss read back after every fifth
// iteration, which ends a sample. A median does not see the refinements, which cost about 1 % on average.
TrainSettings frozen_training(const BenchScene& scene, const IterationOptions& options);
IterationMeasurement measure_iterations(Device& device, const BenchScene& scene,
                                        const IterationOptions& options);

struct PsnrOptions {
  std::vector<double> targets{20, 25, 28, 30};        // rising [dB]
  double max_seconds = 60;                            // of training
  int evaluate_every = 100;                           // iterations; not counted as training time
  std::function<bool()> stop = [] { return false; };  // asked after each iteration
};

struct PsnrTime {
  double target = 0;
  std::optional<double> seconds;  // empty: not reached
};
struct PsnrMeasurement {
  std::vector<PsnrTime> times;  // interpolated between evaluations
  double best = 0, seconds = 0;
  int iterations = 0;
  std::uint64_t peak_bytes = 0;
};

// What a training that is measured begins with.
struct PsnrData {
  TrainSettings settings;
  Split train, test;
  SplatModel initial;
};

// The joint PSNR over the test views of real training with `settings`.
PsnrMeasurement measure_time_to_psnr(Device& device, const TrainSettings& settings, const Split& train,
                                     const Split& test, SplatModel initial, const PsnrOptions& options);

}  // namespace ubs::bench
