// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/device_model.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {

std::uint32_t row_stride(std::size_t capacity) {
  constexpr std::size_t multiple = 64;
  if (capacity > 0xfffffe00u) fail(ErrorKind::memory, "{} splats exceed the 32-bit index range", capacity);
  const std::size_t units = (std::max<std::size_t>(capacity, 1) + multiple - 1) / multiple;
  return static_cast<std::uint32_t>((units | 1) * multiple);
}

DeviceModel::DeviceModel(Device& device, const SplatModel& model, std::size_t capacity)
    : layout_(model.layout()),
      count_(static_cast<std::uint32_t>(model.count)),
      stride_(row_stride(std::max(capacity, model.count))),
      params_(device, "parameters", static_cast<std::size_t>(layout_.count) * stride_) {
  upload(model);
}

void DeviceModel::upload(const SplatModel& model) {
  if (model.count > stride_ || model.dim != layout_.dim || model.variant != layout_.variant)
    fail(ErrorKind::internal,
         "{} splats with N = {} do not fit into a model with N = {} and a capacity of {}", model.count,
         model.dim, layout_.dim, stride_);
  count_ = static_cast<std::uint32_t>(model.count);
  params_.zero();
  for (int r = 0; r < layout_.count; ++r) params_.upload(model.row(r), static_cast<std::size_t>(r) * stride_);
}

SplatModel DeviceModel::download() const { return download_rows(params_, layout_, count_, stride_); }

SplatModel download_rows(const Buffer<float>& buffer, const ParameterLayout& layout, std::uint32_t count,
                         std::uint32_t stride) {
  SplatModel model(layout.dim, count, layout.variant);
  for (int r = 0; r < layout.count; ++r) buffer.download(model.row(r), static_cast<std::size_t>(r) * stride);
  return model;
}

}  // namespace ubs
