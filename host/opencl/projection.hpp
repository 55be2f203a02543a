// SPDX-License-Identifier: Apache-2.0
// Conditioning + projection, forward and backward (kernels/map/project.cl), and backward with the optimiser's
// step (learn.cl) or to the camera (camera.cl).
#pragma once

#include <string>
#include <string_view>

#include "host/opencl/core_groups.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// The option that gives a work-item twice the registers, of which backward needs 250 values; empty where
// Intel's compiler has it not. From the device's extensions and CL_DEVICE_IP_VERSION_INTEL.
std::string large_register_option(std::string_view extensions, std::uint32_t ip_version);

class Projection {
 public:
  Projection(OpenclDevice& device, const KernelConfig& config);
  void run(const ProjectForward& args);
  void run(const ProjectBackward& args);
  // Whether run(Learn) has a kernel: on CPUs. On cards its three parts are faster, one after the other:
  // gradient and Adam's state of a splat fill so many registers that few work-items run at a time
  // (docs/results/2026-11-26-h200.md).
  bool learns_in_one_pass() const { return learns_in_one_pass_; }
  void run(const Learn& args);
  void run(const CameraBackward& args);

 private:
  // A kernel over `count` splats.
  template <typename Signature, typename... Args>
  void launch(Declared<Signature> kernel, std::uint32_t count, const Args&... args);

  unsigned width_;     // lanes of a work-item
  std::size_t group_;  // work-items of a group, where it is not the cores that choose
  bool learns_in_one_pass_;
  KernelConfig config_;
  std::size_t rows_, trained_rows_;  // parameters of a splat, those that are learnt
  CoreGroups core_groups_;
  KernelSet kernels_, camera_kernels_;
};

}  // namespace ubs::opencl
