// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/sky.hpp"

#include "host/device/stage_checks.hpp"

namespace ubs::opencl {

// UBS_COLOUR 3: harmonics up to degree 2.
SkyKernels::SkyKernels(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      width_(config.raster == RasterKind::gpu ? 1 : device.vector_width()),
      map_(device, {{"math/rotation.h", "math/colour.h", "map/row_sums.cl", "map/sky.h", "map/sky.cl"},
                    {"-DUBS_VW=" + std::to_string(width_), "-DUBS_COLOUR=3"}}),
      step_(device, {{"math/adam.h", "map/sky.h", "map/sky_step.cl"}, {"-DUBS_VW=1"}}) {}

void SkyKernels::draw(const DrawSky& a) {
  check_sky(a);
  const ImageShape& s = a.shape;
  map_[kDrawSky]({vectors(s.pitch()), static_cast<std::size_t>(s.rows())}, {kFlatGroup}, a.cameras, a.camera,
                 a.sky, s.pitch(), s.rows(), a.transmittance, a.image);
}

void SkyKernels::gradient(const SkyGradient& a) {
  check_sky(a);
  const ImageShape& s = a.shape;
  const int strips = s.tiles_y(), rows = kSkyNumbers * strips;
  const std::size_t size = static_cast<std::size_t>(rows) * static_cast<std::size_t>(s.pitch());
  if (sums_.size() < size) sums_ = Buffer<float>(device_, "sky sums", size);
  map_[kSkyVjp]({vectors(s.pitch()), static_cast<std::size_t>(strips)}, {kFlatGroup}, a.cameras, a.camera,
                s.width, s.height, s.pitch(), s.rows(), a.transmittance, a.v_image, sums_.view());
  map_[kRowSums]({round_up(static_cast<std::size_t>(rows), kFlatGroup)}, {kFlatGroup}, sums_.view(),
                 s.pitch(), rows);
  map_[kSkyGradient]({kFlatGroup}, {kFlatGroup}, sums_.view(), s.pitch(), strips, a.gradient,
                     a.gradient_offset);
}

void SkyKernels::step(const SkyStep& a) {
  check_sky(a);
  const BiasCorrection bias = bias_correction({.step = a.step});
  step_[kSkyStep]({kFlatGroup}, {kFlatGroup}, a.state, a.gradient, a.views, a.rate, a.rate_harmonics,
                  AdamStep{}.beta1, AdamStep{}.beta2, a.epsilon, bias.inverse1, bias.inverse_sqrt2,
                  a.sentinel, a.stamp);
}

}  // namespace ubs::opencl
