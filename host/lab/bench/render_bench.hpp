// SPDX-License-Identifier: Apache-2.0
// RenderBench measures how long rendering takes. It renders a model in the same way as `ubs render`, so the
// splats may have different dimensions.
#pragma once

#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/operation.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs::bench {

class RenderBench {
 public:
  // Uploads the model of the scene and renders its first view.
  RenderBench(Device& device, const BenchScene& scene, RasterKind raster, const TrainSettings& training = {});

  Measured measure(const SamplingLimits& limits);  // renders the views in turn
  std::uint64_t peak_bytes() const { return peak_bytes_; }

 private:
  void draw();

  Device& device_;
  DeviceGroups model_;
  Renderer renderer_;
  RenderSettings settings_;
  std::uint32_t view_ = 0;
  std::uint64_t peak_bytes_ = 0;
};

}  // namespace ubs::bench
