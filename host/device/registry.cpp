// SPDX-License-Identifier: Apache-2.0
#include "host/device/registry.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>

#include "host/base/error.hpp"
#include "host/opencl/platform.hpp"

namespace ubs {
namespace {

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

std::string list_text(const std::vector<DeviceInfo>& devices) {
  std::string text;
  for (std::size_t i = 0; i < devices.size(); ++i)
    text += fmt::format("{}{}: {}", i ? "; " : "", i, describe(devices[i]));
  return text;
}

}  // namespace

std::vector<DeviceInfo> list_devices() { return opencl::list_devices(); }

std::size_t choose_device(const std::vector<DeviceInfo>& devices, const std::string& request) {
  if (devices.empty())
    fail(ErrorKind::device, "no OpenCL device found; install a driver (for a CPU: the package pocl-opencl-icd)");
  std::string wanted = request;
  std::string origin = "--device";
  if (wanted.empty()) {
    const char* variable = std::getenv("UBS_DEVICE");
    wanted = variable ? variable : "";
    origin = "UBS_DEVICE";
  }
  const auto first_of = [&](DeviceType type) {
    return std::find_if(devices.begin(), devices.end(), [&](const DeviceInfo& d) { return d.type == type; });
  };
  if (wanted.empty()) {
    const auto gpu = first_of(DeviceType::gpu);
    return gpu == devices.end() ? 0 : static_cast<std::size_t>(gpu - devices.begin());
  }
  wanted = lower(wanted);
  if (std::all_of(wanted.begin(), wanted.end(), [](unsigned char c) { return std::isdigit(c); })) {
    const std::size_t index = wanted.size() < 6 ? std::stoul(wanted) : devices.size();
    if (index < devices.size()) return index;
  } else {
    for (const DeviceType type : {DeviceType::cpu, DeviceType::gpu, DeviceType::accelerator})
      if (wanted == to_string(type))
        if (const auto found = first_of(type); found != devices.end())
          return static_cast<std::size_t>(found - devices.begin());
    for (std::size_t i = 0; i < devices.size(); ++i) {
      const DeviceInfo& d = devices[i];
      for (const std::string& text : {d.platform, d.vendor, d.name})
        if (lower(text).find(wanted) != std::string::npos) return i;
    }
  }
  fail(ErrorKind::device, "{} '{}' matches no device; there are: {}", origin, wanted, list_text(devices));
}

std::unique_ptr<Device> open_device(std::size_t index) { return opencl::open_device(index); }

std::unique_ptr<Device> open_device(const std::string& request) {
  return open_device(choose_device(list_devices(), request));
}

std::unique_ptr<Stages> make_stages(Device& device, const KernelConfig& config) {
  if (config.dim < 3 || config.dim > 11)
    fail(ErrorKind::usage, "splats have 3 to 11 dimensions, not {}", config.dim);
  check_variant(config.dim, config.variant);
  return opencl::make_stages(device, config);
}

RasterKind raster_kind(const std::string& choice, const DeviceInfo& info) {
  if (choice == "cpu") return RasterKind::cpu;
  if (choice == "gpu") return RasterKind::gpu;
  if (choice == "auto") return info.type == DeviceType::cpu ? RasterKind::cpu : RasterKind::gpu;
  fail(ErrorKind::usage, "raster is cpu, gpu or auto, not '{}'", choice);
}

}  // namespace ubs
