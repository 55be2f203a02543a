// SPDX-License-Identifier: Apache-2.0
// tune() chooses the tuned constants of a device for `ubs-lab tune`. It times the stages of a training step
// on a synthetic scene.
#pragma once

#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/tuner.hpp"

namespace ubs::bench {

// Returns the synthetic object in a size that keeps the device busy: 300K splats on 800x800 pixels for GPUs,
// and 100K on 400x400 for other devices. If `quick` is true, the object has only 3K splats on 64x64 pixels.
BenchScene tuning_scene(const DeviceInfo& device, bool quick);

// Runs choose_values() for a device. Afterwards the device uses the chosen values. Throws Error(usage) if the
// back end of the device has no tuned constants.
TuningValues tune(Device& device, const BenchScene& scene, const TuneOptions& options);

}  // namespace ubs::bench
