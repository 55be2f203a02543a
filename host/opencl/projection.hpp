// SPDX-License-Identifier: Apache-2.0
// Projection runs conditioning and projection, forward and backward (kernels/map/project.cl). It has two more
// backward passes: one that includes the step of the optimiser (learn.cl), and one for the gradient of the
// camera (camera.cl).
#pragma once

#include <string>
#include <string_view>

#include "host/opencl/core_groups.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// Returns the option that doubles the registers per work-item, because backward needs 250 values. Returns an
// empty string if Intel's compiler does not support it. Depends on the device's extensions and on
// CL_DEVICE_IP_VERSION_INTEL.
std::string large_register_option(std::string_view extensions, std::uint32_t ip_version);

class Projection {
 public:
  Projection(OpenclDevice& device, const KernelConfig& config);
  void run(const ProjectForward& args);
  void run(const ProjectBackward& args);
  // Returns whether run(Learn) is one kernel, which is the case on CPUs. On GPUs it is faster to run its
  // three parts one after the other: together, the gradient and the Adam state of a splat take so many
  // registers that few work-items can run at the same time (docs/results/2026-11-26-h200.md).
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
  std::size_t rows_, trained_rows_;  // number of rows of all parameters, and of the trained ones
  CoreGroups core_groups_;
  KernelSet kernels_, camera_kernels_;
};

}  // namespace ubs::opencl
