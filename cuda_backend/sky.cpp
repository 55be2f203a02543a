// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/sky.hpp"

#include "cuda_backend/grid.hpp"
#include "host/device/stage_checks.hpp"

namespace ubs::cuda {

void Sky::draw(const DrawSky& a) {
  check_sky(a);
  const ImageShape& s = a.shape;
  const dim3 grid{blocks(static_cast<std::uint64_t>(s.pitch()), kMapBlock), static_cast<unsigned>(s.rows()),
                  1};
  device_.launch("draw_sky", kernels_.draw, grid, kMapBlock, a.cameras, a.camera, a.sky, s.pitch(), s.rows(),
                 a.transmittance, a.image);
}

void Sky::gradient(const SkyGradient& a) {
  check_sky(a);
  const ImageShape& s = a.shape;
  const int strips = s.tiles_y(), rows = kSkyNumbers * strips;
  reserve(device_, sums_, "sky sums", static_cast<std::size_t>(rows) * static_cast<std::size_t>(s.pitch()));
  const dim3 grid{blocks(static_cast<std::uint64_t>(s.pitch()), kMapBlock), static_cast<unsigned>(strips), 1};
  device_.launch("sky_vjp", kernels_.vjp, grid, kMapBlock, a.cameras, a.camera, s.width, s.height, s.pitch(),
                 s.rows(), a.transmittance, a.v_image, sums_.view());
  device_.launch("row_sums", kernels_.row_sums, blocks(static_cast<std::uint64_t>(rows), kMapBlock),
                 kMapBlock, sums_.view(), s.pitch(), rows);
  device_.launch("sky_gradient", kernels_.gradient, 1, kMapBlock, sums_.view(), s.pitch(), strips, a.gradient,
                 a.gradient_offset);
}

void Sky::step(const SkyStep& a) {
  check_sky(a);
  const BiasCorrection bias = bias_correction({.step = a.step});
  device_.launch("sky_step", kernels_.step, 1, kMapBlock, a.state, a.gradient, a.views, a.rate,
                 a.rate_harmonics, AdamStep{}.beta1, AdamStep{}.beta2, a.epsilon, bias.inverse1,
                 bias.inverse_sqrt2, a.sentinel, a.stamp);
}

}  // namespace ubs::cuda
