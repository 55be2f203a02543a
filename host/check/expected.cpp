// SPDX-License-Identifier: Apache-2.0
#include "host/check/expected.hpp"

#include <algorithm>

#include "host/oracle/scenes.hpp"
#include "host/oracle/study.hpp"

namespace ubs::check {
namespace {

// Tiles with more splats than a batch of any rasteriser (128, kernels/opencl/raster_gpu.cl), and an image
// that ends inside of tiles and blocks.
constexpr std::size_t kSplats = 400;
constexpr int kWidth = 45, kHeight = 35;

// Least raw spatial beta: an exponent of 2, with which a kernel ends without a step in its slope. Below 1 the
// gradient of a pixel on the rim has hardly a digit in single precision, on any device.
constexpr float kMinBeta = -0.69f;

}  // namespace

Expected expect(const KernelConfig& config) {
  const oracle::Scene scene = oracle::regular_scene({.count = kSplats,
                                                     .dim = config.dim,
                                                     .seed = static_cast<std::uint64_t>(config.dim),
                                                     .width = kWidth,
                                                     .height = kHeight,
                                                     .variant = config.variant});
  Expected e;
  e.problem.model = scene.model;
  const ParameterLayout layout = scene.model.layout();
  if (config.variant.has_spatial_beta())
    for (float& beta : e.problem.model.row(layout.beta)) beta = std::max(beta, kMinBeta);
  e.problem.camera = scene.camera;
  e.problem.target.assign(scene.target.begin(), scene.target.end());
  for (std::size_t c = 0; c < 3; ++c) e.problem.background[c] = static_cast<float>(scene.background[c]);
  e.problem.query_grad = config.query_grad;
  const std::vector<double> no_weights(e.problem.target.size(), 0.0);
  e.problem.undecided = oracle::study(oracle::to_model(e.problem.model), e.problem.camera, no_weights,
                                      accuracy::oracle_options(e.problem), {.gradient = false})
                            .undecided;
  e.whole = accuracy::compute_truth(e.problem);
  e.stages = accuracy::compute_stage_truth(e.problem);
  return e;
}

}  // namespace ubs::check
