// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/appearance.hpp"

#include "host/device/stage_checks.hpp"

namespace ubs::opencl {

AppearanceKernels::AppearanceKernels(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      width_(config.raster == RasterKind::gpu ? 1 : device.vector_width()),
      map_(device, {{"math/appearance.h", "map/row_sums.cl", "map/appearance.cl"},
                    {"-DUBS_VW=" + std::to_string(width_)}}),
      step_(device, {{"math/adam.h", "math/appearance.h", "map/appearance_step.cl"}, {"-DUBS_VW=1"}}) {}

BufferView<float> AppearanceKernels::map(const ImageLoss& loss) {
  check_image_loss(loss);
  const std::size_t plane = loss.shape.plane();
  if (mapped_.size() < 3 * plane) mapped_ = Buffer<float>(device_, "mapped image", 3 * plane);
  map_[kMapColours]({vectors(plane)}, {kFlatGroup}, loss.image, static_cast<std::uint32_t>(plane),
                    loss.appearance, loss.appearance_offset, mapped_.view());
  return mapped_.view();
}

void AppearanceKernels::gradient(const ImageLoss& loss) {
  const ImageShape& s = loss.shape;
  const auto pitch = static_cast<std::size_t>(s.pitch());
  const int strips = s.tiles_y();
  const int rows = kAppearanceNumbers * strips;
  const std::size_t size = static_cast<std::size_t>(rows) * pitch;
  if (sums_.size() < size) sums_ = Buffer<float>(device_, "appearance sums", size);
  map_[kMapColoursVjp]({vectors(pitch), static_cast<std::size_t>(strips)}, {kFlatGroup}, loss.image, s.width,
                       s.height, s.pitch(), s.rows(), loss.appearance, loss.appearance_offset, loss.v_image,
                       sums_.view());
  map_[kRowSums]({round_up(static_cast<std::size_t>(rows), kFlatGroup)}, {kFlatGroup}, sums_.view(),
                 s.pitch(), rows);
  map_[kAppearanceGradient]({kFlatGroup}, {kFlatGroup}, sums_.view(), s.pitch(), strips, loss.appearance,
                            loss.appearance_offset, loss.v_appearance, loss.v_appearance_offset);
}

void AppearanceKernels::step(const AppearanceStep& a) {
  check_appearance(a);
  step_[kAppearanceStep]({kFlatGroup}, {kFlatGroup}, a.state, a.images, a.image, a.gradient,
                         a.gradient_offset, a.rate_diagonal, a.rate_other, AdamStep{}.beta1, AdamStep{}.beta2,
                         AdamStep{}.epsilon, a.sentinel, a.stamp);
}

}  // namespace ubs::opencl
