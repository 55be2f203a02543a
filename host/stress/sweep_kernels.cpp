// SPDX-License-Identifier: Apache-2.0
#include "host/stress/sweep_kernels.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "host/base/error.hpp"
#include "host/stress/sweep_cases.hpp"
#include "kernels/layout.h"

namespace ubs::stress {
namespace {

using opencl::ProgramSpec;
using opencl::Range;

constexpr std::size_t kGroup = 16;

ProgramSpec projection_program(const opencl::OpenclDevice& device, int dim, Formulation formulation,
                               const ModelVariant& variant) {
  const std::string folder = formulation == Formulation::safe ? "math/" : "naive/";
  return opencl::splat_program(device, {.dim = dim, .variant = variant},
                               {"math/rotation.h", "math/covariance.h", folder + "conditional.h",
                                folder + "ellipse.h", "math/projection.h", "math/colour.h", "math/reach.h",
                                "math/splat.h", "map/records.h", "map/project.cl"});
}

ProgramSpec blend_program(const opencl::OpenclDevice& device, int dim, Formulation formulation) {
  const std::string folder = formulation == Formulation::safe ? "math/" : "naive/";
  ProgramSpec spec =
      opencl::splat_program(device, {.dim = dim}, {folder + "blend.h", "opencl/blend_probe.cl"});
  spec.options.push_back(fmt::format("-DUBS_PROBE_POINTS={}", kSweepPoints));
  return spec;
}

}  // namespace

opencl::OpenclDevice& opencl_of(Device& device) {
  if (auto* found = dynamic_cast<opencl::OpenclDevice*>(&device)) return *found;
  fail(ErrorKind::device,
       "sweeps need an OpenCL device, {} is none: their naive kernels are compiled at run time",
       device.info().name);
}

SweepKernels::SweepKernels(opencl::OpenclDevice& device, int dim, Formulation formulation,
                           const ModelVariant& variant)
    : device_(device),
      projection_(device, projection_program(device, dim, formulation, variant)),
      blending_(device, blend_program(device, dim, formulation)),
      cameras_(device, "sweep camera", UBS_CAMERA_STRIDE) {}

void SweepKernels::upload(std::span<const float> params, std::uint32_t count, std::uint32_t stride,
                          const Camera& camera, const ProjectionSettings& settings) {
  count_ = count, stride_ = stride, settings_ = settings;
  std::array<float, UBS_CAMERA_STRIDE> record{};
  std::ranges::copy(camera.rotation, record.begin() + UBS_CAM_ROTATION);
  std::ranges::copy(camera.centre(), record.begin() + UBS_CAM_CENTRE);
  const double intrinsics[] = {camera.fx,
                               camera.fy,
                               camera.cx,
                               camera.cy,
                               static_cast<double>(camera.width),
                               static_cast<double>(camera.height),
                               camera.time};
  static_assert(UBS_CAM_QUERY == UBS_CAM_FOCAL + 6);
  std::ranges::transform(intrinsics, record.begin() + UBS_CAM_FOCAL,
                         [](double v) { return static_cast<float>(v); });
  cameras_.upload(record);
  params_ = Buffer<float>(device_, "sweep parameters", params.size());
  v_params_ = Buffer<float>(device_, "sweep gradient", params.size());
  records_ = Buffer<float>(device_, "sweep records", static_cast<std::size_t>(stride) * UBS_SPLAT_STRIDE);
  keys_ = Buffer<std::uint32_t>(device_, "sweep keys", stride);
  rects_ = Buffer<std::uint32_t>(device_, "sweep rectangles", 2 * static_cast<std::size_t>(stride));
  tiles_ = Buffer<std::uint32_t>(device_, "sweep tiles", stride);
  params_.upload(params);
}

Range SweepKernels::items() const {
  const std::size_t width = device_.vector_width();
  return {opencl::round_up((count_ + width - 1) / width, kGroup)};
}

void SweepKernels::project_forward() {
  projection_["project_forward"](items(), Range{kGroup}, params_.view(), count_, stride_, 0u, cameras_.view(),
                                 0u, settings_.near_plane, settings_.far_plane, settings_.eps2d,
                                 records_.view(), keys_.view(), rects_.view(), tiles_.view());
}

void SweepKernels::project_backward(const Buffer<float>& v_records) {
  projection_["project_backward"](items(), Range{kGroup}, params_.view(), count_, stride_, 0u,
                                  cameras_.view(), 0u, settings_.near_plane, settings_.far_plane,
                                  settings_.eps2d, v_records.view(), v_params_.view(), 0u);
}

void SweepKernels::blend(const Buffer<float>& records, std::uint32_t stacks, std::uint32_t layers,
                         const Buffer<float>& points, const Buffer<float>& v_image, Buffer<float>& image,
                         Buffer<float>& v_records) {
  blending_["blend_probe"](Range{opencl::round_up(stacks, kGroup)}, Range{kGroup}, records.view(), stacks,
                           layers, points.view(), v_image.view(), image.view(), v_records.view());
}

std::vector<bool> SweepKernels::drawn() const {
  std::vector<bool> result;
  for (const std::uint32_t key : keys_.download()) result.push_back(key != UBS_KEY_CULLED);
  return result;
}

}  // namespace ubs::stress
