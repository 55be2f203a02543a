// SPDX-License-Identifier: Apache-2.0
// The kernels of a configuration: those compiled ahead of time for the default form, else a program compiled
// at run time (docs/cuda.md). With UBS_KERNEL_DIR, which replaces sources, all that may be is compiled at run
// time.
#pragma once

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {

ProjectKernels project_kernels(CudaDevice& device, const KernelConfig& config);
CameraKernels camera_kernels(CudaDevice& device, const KernelConfig& config);
ParameterKernels parameter_kernels(CudaDevice& device, const KernelConfig& config);
RasterKernels raster_kernels(CudaDevice& device, const KernelConfig& config);
WeightKernels weight_kernels(CudaDevice& device, const KernelConfig& config);

// The programs that a configuration would have compiled at run time, all of them: for tests.
std::vector<ProgramSpec> run_time_programs(const KernelConfig& config);

}  // namespace ubs::cuda
