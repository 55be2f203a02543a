// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/appearance.hpp"

#include "cuda_backend/grid.hpp"
#include "host/device/stage_checks.hpp"

namespace ubs::cuda {

BufferView<float> Appearance::map(const ImageLoss& loss) {
  check_image_loss(loss);
  const std::size_t plane = loss.shape.plane();
  reserve(device_, mapped_, "mapped image", 3 * plane);
  device_.launch("map_colours", kernels_.map, blocks(plane, kMapBlock), kMapBlock, loss.image,
                 static_cast<u32>(plane), loss.appearance, loss.appearance_offset, mapped_.view());
  return mapped_.view();
}

void Appearance::gradient(const ImageLoss& loss) {
  const ImageShape& s = loss.shape;
  const int strips = s.tiles_y(), rows = kAppearanceNumbers * strips;
  reserve(device_, sums_, "appearance sums",
          static_cast<std::size_t>(rows) * static_cast<std::size_t>(s.pitch()));
  const dim3 grid{blocks(static_cast<std::uint64_t>(s.pitch()), kMapBlock), static_cast<unsigned>(strips), 1};
  device_.launch("map_colours_vjp", kernels_.map_vjp, grid, kMapBlock, loss.image, s.width, s.height,
                 s.pitch(), s.rows(), loss.appearance, loss.appearance_offset, loss.v_image, sums_.view());
  device_.launch("row_sums", kernels_.row_sums, blocks(static_cast<std::uint64_t>(rows), kMapBlock),
                 kMapBlock, sums_.view(), s.pitch(), rows);
  device_.launch("appearance_gradient", kernels_.gradient, 1, kMapBlock, sums_.view(), s.pitch(), strips,
                 loss.appearance, loss.appearance_offset, loss.v_appearance, loss.v_appearance_offset);
}

void Appearance::step(const AppearanceStep& a) {
  check_appearance(a);
  device_.launch("appearance_step", kernels_.step, 1, kMapBlock, a.state, a.images, a.image, a.gradient,
                 a.gradient_offset, a.rate_diagonal, a.rate_other, AdamStep{}.beta1, AdamStep{}.beta2,
                 AdamStep{}.epsilon, a.sentinel, a.stamp);
}

}  // namespace ubs::cuda
