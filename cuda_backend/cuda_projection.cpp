// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_projection.hpp"

#include "cuda_backend/grid.hpp"
#include "cuda_backend/kernel_choice.hpp"
#include "host/device/operation_checks.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::cuda {

unsigned map_block(const CudaDevice& device) {
  return tuned_value(tuned_constants(), device.info().tuning, kTunedMapBlock);
}

Projection::Projection(CudaDevice& device, const KernelConfig& config)
    : device_(device),
      config_(config),
      rows_(config.gaussian_arrays
                ? 0  // the parameters are not in rows
                : static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
      project_(project_kernels(device, config)),
      block_(map_block(device)) {}

dim3 Projection::items(u32 count) const { return {blocks(count, block_), 1, 1}; }

void Projection::run(const ProjectForward& a) {
  check_view(a.splats, rows_);
  device_.launch("project_forward", project_.forward, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                 a.settings.far_plane, a.settings.eps2d, a.records, a.depth_keys, a.tile_rects,
                 a.tile_counts);
}

void Projection::run(const ProjectBackward& a) {
  check_project_backward(config_, a);
  check_view(a.splats, rows_);
  device_.launch("project_backward", project_.backward, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                 a.settings.far_plane, a.settings.eps2d, a.v_records, a.v_params,
                 static_cast<u32>(a.accumulate));
}

void Projection::run(const CameraBackward& work) {
  check_camera_backward(config_, work);
  const ProjectBackward& a = work.gradient;
  check_view(a.splats, rows_);
  if (!camera_.backward.symbol && !camera_.backward.function) camera_ = camera_kernels(device_, config_);
  device_.launch("camera_backward", camera_.backward, items(work.lanes), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                 a.settings.far_plane, a.settings.eps2d, a.v_records, work.v_camera, work.lanes);
}

}  // namespace ubs::cuda
