// SPDX-License-Identifier: Apache-2.0
// DeviceModel holds the raw parameters of a splat model on a device, as rows of `stride` floats
// (kernels/layout.h).
#pragma once

#include "host/device/stages.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// Returns the distance between the starts of two consecutive rows in floats, for rows with a capacity of
// `capacity` splats. The distance is an odd multiple of 64. Kernels read all rows of parameters and moments
// at the same time. If the distance were a multiple of 16 KiB, the values of one splat in all rows would
// compete for the same 12 lines of a CPU's L1 cache.
std::uint32_t row_stride(std::size_t capacity);

class DeviceModel {
 public:
  // Uploads the model. The memory is allocated for `capacity` splats, or for the splats of the model if there
  // are more of them. The number of splats can later grow up to the capacity without a new allocation.
  DeviceModel(Device& device, const SplatModel& model, std::size_t capacity = 0);

  const ParameterLayout& layout() const { return layout_; }
  int dim() const { return layout_.dim; }
  int rows() const { return layout_.count; }
  std::uint32_t count() const { return count_; }
  std::uint32_t stride() const { return stride_; }
  void set_count(std::uint32_t count) { count_ = count; }
  Buffer<float>& params() { return params_; }  // (rows, stride)
  const Buffer<float>& params() const { return params_; }
  SplatView view() const { return {params_.view(), count_, stride_}; }
  SplatModel download() const;
  // Replaces all splats. The capacity stays the same. Throws Error(internal) if `model` has more splats than
  // the capacity, or another dimension or variant.
  void upload(const SplatModel& model);

 private:
  ParameterLayout layout_;
  std::uint32_t count_ = 0, stride_ = 0;
  Buffer<float> params_;
};

// Downloads a device array that has the layout of the parameters (gradients, moments) into a SplatModel.
SplatModel download_rows(const Buffer<float>& buffer, const ParameterLayout& layout, std::uint32_t count,
                         std::uint32_t stride);

}  // namespace ubs
