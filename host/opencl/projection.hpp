// SPDX-License-Identifier: Apache-2.0
// Projection runs the conditioning and the projection of splats, forward and backward
// (kernels/map/project.cl). It has two more backward passes: one that includes the step of the optimiser
// (kernels/map/learn.cl), and one for the gradient of the camera (kernels/map/camera.cl).
#pragma once

#include <string>
#include <string_view>

#include "host/opencl/core_groups.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// Returns the compiler option that doubles the number of registers per work-item on Intel GPUs. The backward
// pass needs 250 values per work-item. Returns an empty string if the device does not support the option.
// `extensions` are the extensions of the device, and `ip_version` is its CL_DEVICE_IP_VERSION_INTEL.
std::string large_register_option(std::string_view extensions, std::uint32_t ip_version);

class Projection {
 public:
  Projection(OpenclDevice& device, const KernelConfig& config);
  void run(const ProjectForward& args);
  void run(const ProjectBackward& args);
  // Returns whether run(Learn) launches a single kernel, which is the case on CPUs. On GPUs it is faster to
  // run its three parts one after the other. In a single kernel, the gradient and the Adam state of a splat
  // take so many registers that few work-items can run at the same time (docs/results/2026-11-26-h200.md).
  bool learns_in_one_pass() const { return learns_in_one_pass_; }
  void run(const Learn& args);
  void run(const CameraBackward& args);

 private:
  // Launches a kernel over `count` splats.
  template <typename Signature, typename... Args>
  void launch(Declared<Signature> kernel, std::uint32_t count, const Args&... args);

  unsigned width_;     // lanes per work-item
  std::size_t group_;  // work-items per group; unused with core groups
  bool learns_in_one_pass_;
  KernelConfig config_;
  std::size_t rows_, trained_rows_;  // number of parameter rows of a splat, and of those that are trained
  CoreGroups core_groups_;
  KernelSet kernels_, camera_kernels_;
};

}  // namespace ubs::opencl
