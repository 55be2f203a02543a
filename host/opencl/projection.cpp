// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/projection.hpp"

namespace ubs::opencl {
namespace {

constexpr std::size_t kGroup = 16;

ProgramSpec program(const OpenclDevice& device, const KernelConfig& config) {
  ProgramSpec spec = splat_program(
      device, config,
      {"math/rotation.h", "math/covariance.h", "math/conditional.h", "math/ellipse.h", "math/projection.h",
       "math/colour.h", "math/reach.h", "math/splat.h", "map/records.h", "map/project.cl"});
  if (config.approximation.half_records) spec.sources.insert(spec.sources.end() - 1, "map/half_records.h");
  if (config.query_grad) spec.options.push_back("-DUBS_QUERY_GRAD=1");
  append(spec.options, extent_options(config));
  append(spec.options, frozen_options(config));
  return spec;
}

}  // namespace

Projection::Projection(OpenclDevice& device, const KernelConfig& config)
    : width_(vector_width(device, config)),
      backward_(config.backward),
      kernels_(device, program(device, config)) {}

Range Projection::items(std::uint32_t count) const {
  return {round_up((count + width_ - 1) / width_, kGroup)};
}

void Projection::forward(const ProjectForward& a) {
  kernels_["project_forward"](items(a.splats.count), Range{kGroup}, a.splats.params, a.splats.count,
                              a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                              a.settings.far_plane, a.settings.eps2d, a.records, a.depth_keys, a.tile_rects,
                              a.tile_counts);
}

void Projection::backward(const ProjectBackward& a) {
  if (!backward_) fail(ErrorKind::internal, "projection backward: these stages were made forward only");
  kernels_["project_backward"](items(a.splats.count), Range{kGroup}, a.splats.params, a.splats.count,
                               a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                               a.settings.far_plane, a.settings.eps2d, a.v_records, a.v_params,
                               static_cast<std::uint32_t>(a.accumulate));
}

}  // namespace ubs::opencl
