// SPDX-License-Identifier: Apache-2.0
// What `ubs-lab tune` times on a device: the stages of a training step of a scene, and whole iterations.
#pragma once

#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/tuner.hpp"

namespace ubs::bench {

// The synthetic object of a size that keeps the device busy: 100K splats on 400x400 pixels for OpenCL, 300K
// on 800x800 for CUDA; quick: tiny.
BenchScene tuning_scene(const DeviceInfo& device, bool quick);

// choose_values() for a device, which is left with them.
TuningValues tune(Device& device, const BenchScene& scene, const TuneOptions& options);

}  // namespace ubs::bench
