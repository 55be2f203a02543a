// SPDX-License-Identifier: Apache-2.0
// The kernels that sweeps run, of one dimension, in one of two formulations: those of the product, or with
// the textbook headers of kernels/naive in their place, which know the default variant alone. Only the list
// of sources differs.
#pragma once

#include <span>
#include <vector>

#include "host/device/stages.hpp"
#include "host/opencl/kernel_set.hpp"
#include "host/scene/camera.hpp"

namespace ubs::stress {

enum class Formulation { safe, naive };

// Throws Error(device) for a device of another back end.
opencl::OpenclDevice& opencl_of(Device& device);

class SweepKernels {
 public:
  SweepKernels(opencl::OpenclDevice& device, int dim, Formulation formulation,
               const ModelVariant& variant = {});

  // params: rows of `stride` floats, a multiple of 64. Leaves the records and their number drawn on the
  // device.
  void upload(std::span<const float> params, std::uint32_t count, std::uint32_t stride, const Camera& camera,
              const ProjectionSettings& settings);
  void project_forward();
  void project_backward(const Buffer<float>& v_records);
  // stacks of `layers` records each, kSweepPoints points a stack; see kernels/opencl/blend_probe.cl.
  void blend(const Buffer<float>& records, std::uint32_t stacks, std::uint32_t layers,
             const Buffer<float>& points, const Buffer<float>& v_image, Buffer<float>& image,
             Buffer<float>& v_records);

  const Buffer<float>& records() const { return records_; }
  std::vector<bool> drawn() const;
  std::vector<float> gradient() const { return v_params_.download(); }

 private:
  opencl::Range items() const;

  opencl::OpenclDevice& device_;
  opencl::KernelSet projection_, blending_;
  Buffer<float> params_, cameras_, records_, v_params_;
  Buffer<std::uint32_t> keys_, rects_, tiles_;
  std::uint32_t count_ = 0, stride_ = 0;
  ProjectionSettings settings_;
};

}  // namespace ubs::stress
