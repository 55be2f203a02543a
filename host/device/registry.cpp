// SPDX-License-Identifier: Apache-2.0
#include "host/device/registry.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <mutex>
#include <numeric>
#include <optional>
#include <utility>

#include "host/base/cache_folder.hpp"
#include "host/base/environment.hpp"
#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#ifdef UBS_WITH_CUDA
#include "cuda_backend/cuda_platform.hpp"
#endif
#ifdef UBS_WITH_OPENCL
#include "host/opencl/driver_cache.hpp"
#include "host/opencl/driver_watch.hpp"
#include "host/opencl/platform.hpp"
#endif

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

// Drivers initialise themselves in the first call that lists their devices, and not all of them are prepared
// for two threads that do this at the same time: PoCL 3.1 gives the second thread devices without a name.
// Therefore only one thread at a time lists or opens devices. The mutex is recursive, because a driver may
// cause a warning, and the log function of a program may list devices.
std::recursive_mutex drivers_mutex;

// The table of back ends, in the order in which their devices are listed.
std::vector<Backend>& backends() {
  static std::vector<Backend> all{
      {.name = "cuda",
#ifdef UBS_WITH_CUDA
       .list_devices = cuda::list_devices,
       .open_device = cuda::open_device
#endif
      },
      {.name = "opencl",
#ifdef UBS_WITH_OPENCL
       .list_devices = opencl::list_devices,
       .open_device = [](std::size_t index) { return opencl::open_device(index); },
       .leave_drivers_alone = opencl::leave_drivers_alone,
       .keep_driver_caches = opencl::keep_driver_cache
#endif
      },
  };
  return all;
}

std::vector<DeviceInfo> devices_of(const Backend& backend) {
  return backend.list_devices ? backend.list_devices() : std::vector<DeviceInfo>{};
}

using Candidates = std::vector<std::size_t>;  // indices in the list of devices

// Returns the first candidate of the type `wanted`. If no candidate has this type, returns the first
// candidate whose platform, vendor or name contains `wanted`, or nullopt if there is none. If `wanted` is
// empty, returns the first GPU, or the first candidate if there is no GPU.
std::optional<std::size_t> choose_among(const std::vector<DeviceInfo>& devices, const Candidates& candidates,
                                        const std::string& wanted) {
  const auto first = [&](const auto& matches) -> std::optional<std::size_t> {
    const auto found = std::ranges::find_if(candidates, [&](std::size_t i) { return matches(devices[i]); });
    return found == candidates.end() ? std::nullopt : std::optional(*found);
  };
  if (wanted.empty()) {
    const auto gpu = first([](const DeviceInfo& d) { return d.type == DeviceType::gpu; });
    return gpu ? gpu : first([](const DeviceInfo&) { return true; });
  }
  if (const auto found = first([&](const DeviceInfo& d) { return wanted == to_string(d.type); }))
    return found;
  return first([&](const DeviceInfo& d) {
    return std::ranges::any_of(std::array{d.platform, d.vendor, d.name}, [&](const std::string& text) {
      return lower(text).find(wanted) != std::string::npos;
    });
  });
}

std::optional<std::size_t> find_device(const std::vector<DeviceInfo>& devices, std::string wanted) {
  // The back end is compared before the names, because the OpenCL platform of NVIDIA GPUs is called "NVIDIA
  // CUDA".
  const std::string backend = wanted.substr(0, wanted.find(':'));
  const bool names_backend = std::ranges::find(backends(), backend, &Backend::name) != backends().end();
  if (names_backend) wanted.erase(0, backend.size() + 1);
  Candidates candidates;
  for (std::size_t i = 0; i < devices.size(); ++i)
    if (!names_backend || devices[i].backend == backend) candidates.push_back(i);
  // A number with one or two digits is an index into the candidates. A longer number is a part of a name.
  if (!wanted.empty() && wanted.size() < 3 &&
      std::ranges::all_of(wanted, [](unsigned char c) { return std::isdigit(c); })) {
    const std::size_t place = std::stoul(wanted);
    return place < candidates.size() ? std::optional(candidates[place]) : std::nullopt;
  }
  return choose_among(devices, candidates, wanted);
}

}  // namespace

void register_backend(Backend backend) {
  const std::lock_guard lock(drivers_mutex);
  backends().push_back(std::move(backend));
}

std::vector<DeviceInfo> list_devices() {
  const std::lock_guard lock(drivers_mutex);
  std::vector<DeviceInfo> all;
  for (const Backend& backend : backends())
    for (DeviceInfo& info : devices_of(backend)) all.push_back(std::move(info));
  return all;
}

std::vector<std::size_t> device_candidates(const std::vector<DeviceInfo>& devices,
                                           const std::string& request) {
  // PoCL reports no device if it has no writable folder.
  if (const std::string why = cache_defects(); devices.empty() && !why.empty())
    fail(ErrorKind::data, "cannot store compiled kernels ({}): set UBS_KERNEL_CACHE to a writable folder",
         why);
#ifdef UBS_WITH_OPENCL
  if (devices.empty()) check_driver_fits();  // a driver that ran out of memory lists no device
#endif
  if (devices.empty())
    fail(ErrorKind::device,
         "no compute device found: install the driver of NVIDIA or an OpenCL driver; for a CPU, install "
         "pocl-opencl-icd, which needs a writable folder (POCL_CACHE_DIR, XDG_CACHE_HOME or HOME)");
  const std::string wanted = !request.empty() ? request : environment("UBS_DEVICE");
  if (wanted.empty()) {
    std::vector<std::size_t> all(devices.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    std::stable_partition(all.begin(), all.end(),
                          [&](std::size_t i) { return devices[i].type == DeviceType::gpu; });
    return all;
  }
  if (const auto found = find_device(devices, lower(wanted))) return {*found};
  fail(ErrorKind::device, "{} '{}' matches no device; available: {}",
       request.empty() ? "UBS_DEVICE" : "--device", wanted, list_text(devices));
}

std::size_t choose_device(const std::vector<DeviceInfo>& devices, const std::string& request) {
  return device_candidates(devices, request).front();
}

std::unique_ptr<Device> open_device(std::size_t index) {
  const std::lock_guard lock(drivers_mutex);
  std::size_t before = 0;
  for (const Backend& backend : backends()) {
    const std::size_t count = devices_of(backend).size();
    if (index < before + count) return backend.open_device(index - before);
    before += count;
  }
  fail(ErrorKind::device, "device {} does not exist", index);
}

std::unique_ptr<Device> open_device(const std::string& request) {
  return open_device(choose_device(list_devices(), request));
}

void leave_drivers_alone() {
  for (const Backend& backend : backends())
    if (backend.leave_drivers_alone) backend.leave_drivers_alone();
}

void keep_driver_caches(SetVariable set) {
  for (const Backend& backend : backends())
    if (backend.keep_driver_caches) backend.keep_driver_caches(set);
}

}  // namespace ubs
