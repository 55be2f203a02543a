// SPDX-License-Identifier: Apache-2.0
#include "host/bench/render_bench.hpp"

namespace ubs::bench {
namespace {

KernelConfig forward_only(RasterKind raster, const TrainSettings& training) {
  KernelConfig config{.raster = raster};
  config.work = work_switches(training);
  config.backward = false;
  return config;
}

}  // namespace

RenderBench::RenderBench(Device& device, const BenchScene& scene, RasterKind raster,
                         const TrainSettings& training)
    : device_(device),
      model_(device, scene.mixed, forward_only(raster, training)),
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
