// SPDX-License-Identifier: Apache-2.0
#include "host/device/operations.hpp"

#include "host/base/error.hpp"

namespace ubs {

std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config) {
  if (config.dim < 3 || config.dim > 11)
    fail(ErrorKind::usage, "splats can have 3 to 11 dimensions, not {}", config.dim);
  check_variant(config.dim, config.variant);
  if (config.gaussian_arrays &&
      (config.dim != 3 || config.variant.kernel != SpatialKernel::gaussian || config.variant.lobes() > 0 ||
       config.variant.rot_mode != RotMode::quaternion || config.frozen != 0))
    fail(ErrorKind::internal,
         "gaussian_arrays requires dim = 3, kernel = gaussian, rot_mode = quaternion, no lobes and no frozen "
         "groups");
  return device.make_stages(config);
}

std::unique_ptr<MetricOps> make_metric_ops(Device& device) { return device.make_metric_ops(); }

RasterKind raster_kind(const std::string& choice, const DeviceInfo& info) {
  if (choice == "cpu" && !info.has_cpu_raster)
    fail(ErrorKind::usage, "raster = cpu: {} supports only the kernels for GPUs: use auto or gpu", info.name);
  if (choice == "cpu") return RasterKind::cpu;
  if (choice == "gpu") return RasterKind::gpu;
  if (choice == "auto") return info.float_vector_width > 1 ? RasterKind::cpu : RasterKind::gpu;
  fail(ErrorKind::usage, "raster = '{}': expected cpu, gpu or auto", choice);
}

}  // namespace ubs
