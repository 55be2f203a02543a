// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/projection.hpp"

#include "host/device/operation_checks.hpp"
#include "host/opencl/opencl_tuning.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs::opencl {
namespace {

constexpr std::size_t kCpuGroup = 16;  // work-items per group on CPUs

std::string large_register_option(const OpenclDevice& device) {
  constexpr cl_device_info kIpVersion = 0x4250;  // CL_DEVICE_IP_VERSION_INTEL
  cl_uint version = 0;
  if (clGetDeviceInfo(device.id(), kIpVersion, sizeof version, &version, nullptr) != CL_SUCCESS) return "";
  return opencl::large_register_option(device_text(device.id(), CL_DEVICE_EXTENSIONS), version);
}

bool learns_in_one_pass(const OpenclDevice& device, const KernelConfig& config) {
  return config.backward && !config.gaussian_arrays && device.info().type == DeviceType::cpu;
}

enum class Gradient { parameters, camera };

ProgramSpec program(const OpenclDevice& device, const KernelConfig& config, Gradient gradient) {
  ProgramSpec spec =
      splat_program(device, config,
                    {"math/rotation.h", "math/covariance.h", "math/conditional.h", "math/direct.h",
                     "math/ellipse.h", "math/projection.h", "math/colour.h", "math/falloff.h", "math/reach.h",
                     "math/splat.h", "opencl/shuffles.h", "map/records.h", "map/arrays.h", "map/project.cl"});
  if (gradient == Gradient::camera) {
    spec.sources.push_back("map/camera.cl");
    spec.options.push_back("-DUBS_CAMERA_GRAD=1");
  } else if (learns_in_one_pass(device, config)) {
    spec.sources.insert(spec.sources.end(), {"math/adam.h", "map/adam_row.h", "map/learn.cl"});
  }
  if (config.query_grad && gradient == Gradient::parameters) spec.options.push_back("-DUBS_QUERY_GRAD=1");
  append(spec.options, depth_gradient_options(config));
  append(spec.options, array_options(config));
  append(spec.options, extent_options(config));
  append(spec.options, frozen_options(config));
  if (const std::string option = large_register_option(device); config.backward && !option.empty())
    spec.options.push_back(option);
  append(spec.options, exact_division_options(device));
  return spec;
}

}  // namespace

// GPUs from Xe-HP (version 12.50) on support the option. The IP version contains ten bits for the
// architecture, followed by eight bits for the release. Some drivers use ten bits for the release. Then the
// release that is read here is a quarter of the actual one, so that the GPU appears to be older and does not
// get the option.
std::string large_register_option(std::string_view extensions, std::uint32_t ip_version) {
  const std::uint32_t architecture = ip_version >> 22, release = ip_version >> 14 & 0xff;
  const bool has = architecture > 12 || (architecture == 12 && release >= 50);
  return has && has_word(extensions, "cl_intel_device_attribute_query") ? "-cl-intel-256-GRF-per-thread" : "";
}

Projection::Projection(OpenclDevice& device, const KernelConfig& config)
    : width_(device.vector_width()),
      group_(device.info().type == DeviceType::cpu ? kCpuGroup
                                                   : tuned_value(device.info().tuning, "UBS_PROJECT_GROUP")),
      learns_in_one_pass_(opencl::learns_in_one_pass(device, config)),
      config_(config),
      rows_(static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
      trained_rows_(
          static_cast<std::size_t>(trained_rows(ParameterLayout(config.dim, config.variant), config.frozen))),
      core_groups_(device, cores_for_groups(device)),
      kernels_(device, core_groups_.program(program(device, config, Gradient::parameters))),
      camera_kernels_(device, program(device, config, Gradient::camera)) {}

template <typename Signature, typename... Args>
void Projection::launch(Declared<Signature> kernel, std::uint32_t count, const Args&... args) {
  const std::size_t items = (count + width_ - 1) / width_;
  if (core_groups_)
    core_groups_.launch(kernels_[kernel], round_up(items, kCoreGroupItems) / kCoreGroupItems, args...);
  else
    kernels_[kernel](Range{round_up(items, group_)}, Range{group_}, args...);
}

void Projection::run(const ProjectForward& a) {
  launch(kProjectForward, a.splats.count, a.splats.params, a.splats.count, a.splats.stride, a.first_record,
         a.cameras, a.camera, a.settings.near_plane, a.settings.far_plane, a.settings.eps2d, a.records,
         a.depth_keys, a.tile_rects, a.tile_counts);
}

void Projection::run(const ProjectBackward& a) {
  check_project_backward(config_, a);
  launch(kProjectBackward, a.splats.count, a.splats.params, a.splats.count, a.splats.stride, a.first_record,
         a.cameras, a.camera, a.settings.near_plane, a.settings.far_plane, a.settings.eps2d, a.v_records,
         a.v_params, static_cast<std::uint32_t>(a.accumulate));
}

void Projection::run(const Learn& learn) {
  check_backward(config_, "learning");
  const ProjectBackward& a = learn.gradient;
  const AdamStep& step = learn.step;
  check_adam(step, rows_, trained_rows_);
  if (a.splats.count == 0) return;
  const BiasCorrection bias = bias_correction(step);
  launch(kLearn, a.splats.count, a.splats.params, a.splats.count, a.splats.stride, a.first_record, a.cameras,
         a.camera, a.settings.near_plane, a.settings.far_plane, a.settings.eps2d, a.v_records, a.v_params,
         static_cast<std::uint32_t>(a.accumulate), weights_per_splat(learn.penalty), step.moment1,
         step.moment2, step.learning_rates, step.beta1, step.beta2, step.epsilon, bias.inverse1,
         bias.inverse_sqrt2, step.sentinel, step.stamp);
}

void Projection::run(const CameraBackward& work) {
  check_camera_backward(config_, work);
  const ProjectBackward& a = work.gradient;
  camera_kernels_[kCameraBackward](Range{round_up(work.lanes / width_, group_)}, Range{group_},
                                   a.splats.params, a.splats.count, a.splats.stride, a.first_record,
                                   a.cameras, a.camera, a.settings.near_plane, a.settings.far_plane,
                                   a.settings.eps2d, a.v_records, work.v_camera, work.lanes);
}

}  // namespace ubs::opencl
