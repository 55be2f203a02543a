// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_image_loss.hpp"

#include <limits>

#include "cuda_backend/grid.hpp"
#include "host/device/operation_checks.hpp"
#include "host/device/stage_sizes.hpp"

namespace ubs::cuda {

ImageLossKernels::Maps ImageLossKernels::prepare(const ImageShape& shape) {
  Maps maps;
  maps.pitch = shape.pitch() + stage_sizes::kMapMargin;
  maps.plane = maps.pitch * (shape.rows() + 2 * stage_sizes::kLossRadius);
  if (shape.pitch() == shape_.pitch() && shape.rows() == shape_.rows()) return maps;
  constexpr unsigned planes = 9;
  reserve(device_, maps_, "loss maps", planes * static_cast<std::size_t>(maps.plane));
  device_.launch("loss_margins", plain_.margins, dim3{static_cast<unsigned>(maps.plane / maps.pitch), planes},
                 kLossBlock, maps_.view(), maps.pitch, maps.plane, shape.pitch());
  shape_ = shape;
  return maps;
}

void ImageLossKernels::run(const ImageLoss& loss) {
  check_image_loss(loss);
  const ImageShape& s = loss.shape;
  constexpr int first_channel = 0, channels = 3;
  const dim3 grid{blocks(static_cast<std::uint64_t>(s.pitch()), kLossTileX),
                  blocks(static_cast<std::uint64_t>(s.rows()), stage_sizes::kLossTileRows), channels};
  const unsigned tiles = grid.x * grid.y;
  reserve(device_, tile_sums_, "loss tile sums", 3 * std::size_t{tiles} * 4);
  const bool gradient = loss.v_image.size > 0;
  const LossKernels& kernels = loss.mask.size > 0 ? masked_ : plain_;
  const Maps maps = gradient ? prepare(s) : Maps{};
  const BufferView<std::uint8_t> bytes = loss.target.size > 0 ? loss.target : BufferView<std::uint8_t>{};
  const BufferView<float> floats = loss.target.size > 0 ? BufferView<float>{} : loss.target_float;
  const float limit = std::numeric_limits<float>::max();
  device_.launch("loss_window", kernels.window, grid, kLossBlock, loss.image, bytes, floats, s.width,
                 s.height, s.pitch(), s.rows(), first_channel, channels, loss.clamp ? 0.0f : -limit,
                 loss.clamp ? 1.0f : limit, maps_.view(), maps.pitch, maps.plane, tile_sums_.view(),
                 loss.mask);
  if (gradient) {
    device_.launch("loss_gradient", kernels.gradient, grid, kLossBlock, loss.image, bytes, floats, s.width,
                   s.height, s.pitch(), s.rows(), first_channel, channels, weights_per_value(loss),
                   maps_.view(), maps.pitch, maps.plane, loss.v_image, loss.mask);
  }
  device_.launch("loss_total", kernels.total, 1, kLossTotalBlock, tile_sums_.view(), static_cast<int>(tiles),
                 counted_pixels(loss), loss.sums, loss.sums_offset);
}

}  // namespace ubs::cuda
