// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/image_loss.hpp"

#include <limits>

#include "host/device/operation_checks.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/opencl/opencl_tuning.hpp"

namespace ubs::opencl {
namespace {

// Returns the number of work-items of the group that adds the sums of all tiles (kernels/gpu/loss.cl). Each
// of the three channels needs 64 of them. With vectors (`width` is not 1), the same 64 work-items process one
// channel after the other.
std::size_t total_group(unsigned width) { return width == 1 ? 192 : 64; }

BufferView<std::uint8_t> bytes_of(const ImageLoss& loss) {
  return loss.target.size > 0 ? loss.target : BufferView<std::uint8_t>{};
}
BufferView<float> floats_of(const ImageLoss& loss) {
  return loss.target.size > 0 ? BufferView<float>{} : loss.target_float;
}

// Returns the width of a tile in pixels. With vectors, wider tiles are faster, because each tile also
// computes sums of the pixels around it. For an image of 800 x 800 pixels, the loss takes 2.9 ms with a width
// of 112, and 3.3 ms with 48. With the default UBS_LOSS_STRIP of 4, a width of 112 needs 34 KiB of local
// memory, and 48 needs 17 KiB. With the largest tuned strip of 8, they need 42 and 21 KiB. Devices with the
// full profile of OpenCL have at least 32 KiB; those with the embedded profile may have less.
std::size_t tile_width(const OpenclDevice& device, unsigned width) {
  const auto& tuning = device.info().tuning;
  if (width == 1) return tuned_value(tuning, "UBS_LOSS_TILE_GPU");
  cl_ulong local_bytes = 0;
  check(clGetDeviceInfo(device.id(), CL_DEVICE_LOCAL_MEM_SIZE, sizeof local_bytes, &local_bytes, nullptr),
        "clGetDeviceInfo");
  return tuned_value(tuning, "UBS_LOSS_TILE",
                     local_bytes >= 64 * 1024   ? 112
                     : local_bytes >= 32 * 1024 ? 48
                                                : 16);
}

ProgramSpec program(unsigned width, std::size_t tile_x, bool masked) {
  ProgramSpec spec{{"math/loss.h", "gpu/words.h", "gpu/loss.cl"},
                   {"-DUBS_VW=" + std::to_string(width),
                    (width == 1 ? "-DUBS_LOSS_TILE_GPU=" : "-DUBS_LOSS_TILE=") + std::to_string(tile_x)}};
  if (masked) spec.options.push_back("-DUBS_LOSS_MASK=1");
  return spec;
}

}  // namespace

ImageLossKernels::ImageLossKernels(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      width_(config.raster == RasterKind::gpu ? 1 : device.vector_width()),
      tile_x_(tile_width(device, width_)),
      group_(width_ == 1 ? tuned_value(device.info().tuning, "UBS_LOSS_GROUP") : 1),
      core_groups_(device, width_ == 1 ? 0 : cores_for_groups(device)),
      whole_(device, core_groups_.program(program(width_, tile_x_, false))),
      masked_(device, core_groups_.program(program(width_, tile_x_, true))) {}

KernelSet& ImageLossKernels::kernels(const ImageLoss& loss) { return loss.mask.size > 0 ? masked_ : whole_; }

// On CPUs, each channel of an image above kSmallImage has its own launch, so that its maps stay in the cache.
// An iteration takes the following times:
//
//     pixels                     100 x 100    200 x 200    400 x 400
//     one launch per channel     0.69 ms      3.18 ms      12.95 ms
//     one launch for all         0.64 ms      3.10 ms      13.23 ms
std::size_t ImageLossKernels::channels(const ImageShape& shape) const {
  return width_ == 1 || shape.plane() <= stage_sizes::kSmallImage ? 3 : 1;
}

Range ImageLossKernels::tiles(const ImageShape& shape) const {
  return {round_up(shape.pitch(), tile_x_) / tile_x_, shape.rows() / stage_sizes::kLossTileRows, 1};
}

ImageLossKernels::Maps ImageLossKernels::prepare(const ImageLoss& loss) {
  const ImageShape& shape = loss.shape;
  const Range count = tiles(shape);
  if (tile_sums_.size() < 3 * count.x * count.y * 4)
    tile_sums_ = Buffer<float>(device_, "loss tile sums", 3 * count.x * count.y * 4);
  if (loss.v_image.size == 0) return {};
  Maps maps;
  maps.pitch = shape.pitch() + stage_sizes::kMapMargin;
  maps.plane = maps.pitch * (shape.rows() + 2 * stage_sizes::kLossRadius);
  if (shape.pitch() == shape_.pitch() && shape.rows() == shape_.rows()) return maps;
  const std::size_t planes = channels(shape) * 3, size = planes * maps.plane;
  if (maps_.size() < size) maps_ = Buffer<float>(device_, "loss maps", size);
  kernels(loss)[kLossMargins](Range{maps.plane / maps.pitch * group_, planes}, Range{group_}, maps_.view(),
                              static_cast<int>(maps.pitch), static_cast<int>(maps.plane), shape.pitch());
  shape_ = shape;
  return maps;
}

void ImageLossKernels::run_channels(const ImageLoss& loss, int first_channel, const Maps& maps) {
  const bool gradient = loss.v_image.size > 0;
  const ImageShape& shape = loss.shape;
  const Range count = tiles(shape);
  const int planes = static_cast<int>(channels(shape));
  const float limit = std::numeric_limits<float>::max();
  const float low = loss.clamp ? 0 : -limit, high = loss.clamp ? 1 : limit;
  const int map_pitch = static_cast<int>(maps.pitch), map_plane = static_cast<int>(maps.plane);
  const auto launch = [&](const auto& kernel, const auto&... arguments) {
    if (group_ == 1)
      core_groups_.launch(kernels(loss)[kernel], count.x * count.y * channels(shape), arguments...);
    else
      kernels(loss)[kernel](Range{count.x * group_, count.y, channels(shape)}, Range{group_}, arguments...);
  };
  launch(kLossWindow, loss.image, bytes_of(loss), floats_of(loss), shape.width, shape.height, shape.pitch(),
         shape.rows(), first_channel, planes, low, high, maps_.view(), map_pitch, map_plane,
         tile_sums_.view(), loss.mask);
  if (!gradient) return;
  launch(kLossGradient, loss.image, bytes_of(loss), floats_of(loss), shape.width, shape.height, shape.pitch(),
         shape.rows(), first_channel, planes, weights_per_value(loss), maps_.view(), map_pitch, map_plane,
         loss.v_image, loss.mask);
}

void ImageLossKernels::run(const ImageLoss& loss) {
  check_image_loss(loss);
  const ImageShape& shape = loss.shape;
  const Maps maps = prepare(loss);
  for (int channel = 0; channel < 3; channel += static_cast<int>(channels(shape)))
    run_channels(loss, channel, maps);
  const Range count = tiles(shape);
  kernels(loss)[kLossTotal]({total_group(width_)}, {total_group(width_)}, tile_sums_.view(),
                            static_cast<int>(count.x * count.y), counted_pixels(loss), loss.sums,
                            loss.sums_offset);
}

}  // namespace ubs::opencl
