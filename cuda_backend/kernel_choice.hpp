// SPDX-License-Identifier: Apache-2.0
// Selects the kernels for a configuration: either those that were compiled ahead of time for the default
// variant, or those of a program that is compiled at run time (docs/cuda.md). If the environment variable
// UBS_KERNEL_DIR names a folder that replaces the sources, all kernels for which this is possible are
// compiled at run time.
#pragma once

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {

ProjectKernels project_kernels(CudaDevice& device, const KernelConfig& config);
CameraKernels camera_kernels(CudaDevice& device, const KernelConfig& config);
ParameterKernels parameter_kernels(CudaDevice& device, const KernelConfig& config);
RasterKernels raster_kernels(CudaDevice& device, const KernelConfig& config);
WeightKernels weight_kernels(CudaDevice& device, const KernelConfig& config);

// Returns all programs that a configuration may compile at run time. Used by tests.
std::vector<ProgramSpec> run_time_programs(const KernelConfig& config);

}  // namespace ubs::cuda
