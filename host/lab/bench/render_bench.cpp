// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/render_bench.hpp"

#include "host/train/run_settings.hpp"

namespace ubs::bench {
namespace {

// Returns a configuration for rendering. Its number of dimensions and its variant are not used, because each
// group of the model supplies its own.
KernelConfig forward_only(RasterKind raster, const TrainSettings& training, const DeviceInfo& device) {
  KernelConfig config = kernel_config(KernelConfig{}.dim, {}, training, device);
  config.raster = raster;
  config.backward = false;
  return config;
}

}  // namespace

RenderBench::RenderBench(Device& device, const BenchScene& scene, RasterKind raster,
                         const TrainSettings& training)
    : device_(device),
      model_(device, scene.mixed.mixed() ? scene.mixed : MixedModel(scene.model),
             forward_only(raster, training, device.info())),
      renderer_(device, model_.stages()) {
  settings_.background = scene.background;
  renderer_.set_cameras(cameras_of(scene.views));
  device_.reset_peak();
  draw();
  device_.finish();
  peak_bytes_ = device_.peak_bytes();
}

void RenderBench::draw() {
  renderer_.forward(model_.view(), view_, settings_, false);
  view_ = (view_ + 1) % renderer_.camera_count();
}

Measured RenderBench::measure(const SamplingLimits& limits) {
  return bench::measure(device_, {[this] { draw(); }, {}}, limits);
}

}  // namespace ubs::bench
