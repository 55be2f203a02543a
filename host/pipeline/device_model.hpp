// SPDX-License-Identifier: Apache-2.0
// Raw parameters of a splat model on a device: rows of `stride` floats (kernels/layout.h).
#pragma once

#include "host/device/stages.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// Floats from one row to the next in rows with room for `capacity` splats: an odd multiple of 64. Kernels
// walk through all rows of parameters and moments at a time; rows whose distance is a multiple of 16 KiB,
// which 300 000 splats made, would share 12 lines of a CPU's first cache.
std::uint32_t row_stride(std::size_t capacity);

class DeviceModel {
 public:
  // Room for `capacity` splats (at least model.count); growth within it needs no new memory.
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
  // Replaces all splats; the capacity and the form of the model stay. Throws Error(internal) when they do not
  // fit.
  void upload(const SplatModel& model);

 private:
  ParameterLayout layout_;
  std::uint32_t count_ = 0, stride_ = 0;
  Buffer<float> params_;
};

// A device array in the parameters' layout (gradients, moments) copied into a SplatModel.
SplatModel download_rows(const Buffer<float>& buffer, const ParameterLayout& layout, std::uint32_t count,
                         std::uint32_t stride);

}  // namespace ubs
