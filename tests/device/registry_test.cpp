// SPDX-License-Identifier: Apache-2.0
// Tests the selection of a device if there are several back ends. The devices are a GPU that both CUDA and
// OpenCL list, and a CPU.
#include "host/device/registry.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdlib>

#include "host/device/kernel_options.hpp"
#include "host/device/operations.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

DeviceInfo device(const char* backend, const char* platform, const char* name, DeviceType type) {
  DeviceInfo info;
  info.backend = backend;
  info.platform = platform;
  info.vendor = type == DeviceType::gpu ? "NVIDIA" : "GenuineIntel";
  info.name = name;
  info.type = type;
  info.has_cpu_raster = info.backend == "opencl";
  return info;
}

const std::vector<DeviceInfo> kCardAndCpu{
    device("cuda", "CUDA runtime 13.0", "NVIDIA H200", DeviceType::gpu),
    device("opencl", "Portable Computing Language", "cpu-skylake", DeviceType::cpu),
    device("opencl", "NVIDIA CUDA", "NVIDIA H200", DeviceType::gpu),
};

TEST_CASE(
    "`auto` selects the rasteriser by the vector width, and devices without the rasteriser `cpu` reject it",
    "[registry]") {
  DeviceInfo cpu = kCardAndCpu[1];
  cpu.float_vector_width = 16;
  CHECK(raster_kind("auto", cpu) == RasterKind::cpu);
  cpu.float_vector_width = 1;  // as on the CPU device llvmpipe
  CHECK(raster_kind("auto", cpu) == RasterKind::gpu);
  CHECK(raster_kind("cpu", cpu) == RasterKind::cpu);
  CHECK(raster_kind("auto", kCardAndCpu[0]) == RasterKind::gpu);
  CHECK_THROWS_AS(raster_kind("cpu", kCardAndCpu[0]), Error);
}

TEST_CASE("a device is found by index, type, back end, platform and name", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  const auto chosen = [](const char* request) { return choose_device(kCardAndCpu, request); };
  CHECK(chosen("") == 0);
  CHECK(chosen("gpu") == 0);
  CHECK(chosen("H200") == 0);
  CHECK(chosen("cuda") == 0);  // the back end, although the name of an OpenCL platform contains "CUDA"
  CHECK(chosen("CUDA:h200") == 0);
  CHECK(chosen("cpu") == 1);
  CHECK(chosen("portable") == 1);
  CHECK(chosen("opencl") == 2);  // the first GPU of the back end
  CHECK(chosen("opencl:h200") == 2);
  CHECK(chosen("opencl:cpu") == 1);
  CHECK(chosen("opencl:gpu") == 2);
  CHECK(chosen("2") == 2);
  CHECK(chosen("opencl:1") == 2);  // the second device of the back end
  CHECK(chosen("200") == 0);       // a part of the name, because there is no device 200
}

TEST_CASE("if the user has selected no device, all devices are candidates, GPUs first", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  using Places = std::vector<std::size_t>;
  CHECK(device_candidates(kCardAndCpu, "") == Places{0, 2, 1});
  CHECK(device_candidates(kCardAndCpu, "gpu") == Places{0});
  ::setenv("UBS_DEVICE", "cpu", 1);
  CHECK(device_candidates(kCardAndCpu, "") == Places{1});
  ::unsetenv("UBS_DEVICE");
}

TEST_CASE("without CUDA devices, a request selects an OpenCL device or is an error", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  const std::vector<DeviceInfo> devices(kCardAndCpu.begin() + 1, kCardAndCpu.end());
  CHECK(choose_device(devices, "") == 1);
  CHECK(choose_device(devices, "H200") == 1);
  for (const char* request :
       {"cuda", "cuda:H200", "opencl:A100", "2", "opencl:2", "12345678901234567890", "valve"}) {
    const std::string message = test::message_of([&] { choose_device(devices, request); }, ErrorKind::device);
    INFO(request);
    CHECK(message.find(request) != std::string::npos);
    CHECK(message.find("0: cpu-skylake") != std::string::npos);
  }
  CHECK(!test::message_of([] { choose_device({}, ""); }, ErrorKind::device).empty());
}

TEST_CASE("the name of any back end in the table selects its devices", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  register_backend({.name = "quantum", .list_devices = [] { return std::vector<DeviceInfo>{}; }});
  std::vector<DeviceInfo> devices = kCardAndCpu;
  devices.push_back(device("opencl", "Quantum simulator", "quantum cpu", DeviceType::cpu));
  CHECK_THROWS_AS(choose_device(devices, "quantum"), Error);  // not a part of the name of an OpenCL device
  devices.push_back(device("quantum", "abacus", "first", DeviceType::accelerator));
  devices.push_back(device("quantum", "abacus", "second", DeviceType::accelerator));
  CHECK(choose_device(devices, "quantum") == 4);
  CHECK(choose_device(devices, "Quantum:second") == 5);
  CHECK(choose_device(devices, "quantum:1") == 5);
}

TEST_CASE("UBS_DEVICE selects the device if no option does", "[registry]") {
  ::setenv("UBS_DEVICE", "opencl:cpu", 1);
  CHECK(choose_device(kCardAndCpu, "") == 1);
  CHECK(choose_device(kCardAndCpu, "gpu") == 0);
  ::setenv("UBS_DEVICE", "valve", 1);
  CHECK(
      test::message_of([] { choose_device(kCardAndCpu, ""); }, ErrorKind::device).starts_with("UBS_DEVICE"));
  ::unsetenv("UBS_DEVICE");
}

TEST_CASE("the compiler option UBS_FALLOFF is passed for every spatial kernel except the default",
          "[registry]") {
  for (std::size_t i = 0; i < kSpatialKernels.size(); ++i) {
    const ModelVariant variant{.kernel = static_cast<SpatialKernel>(i)};
    INFO(row_of(variant.kernel).name);
    CHECK(raster_options({.variant = variant}) ==
          (i == 0 ? Options{} : Options{fmt::format("-DUBS_FALLOFF={}", i)}));
    // The number of a user-defined falloff is not that of any kernel, and replaces it.
    for (const Options& options : {raster_options({.variant = variant, .falloff = OwnFalloff{}}),
                                   variant_options({.variant = variant, .falloff = OwnFalloff{}})}) {
      CHECK(std::ranges::count(options, "-DUBS_FALLOFF=-1") == 1);
      CHECK(std::ranges::count_if(options, [](const auto& o) { return o.starts_with("-DUBS_FALLOFF="); }) ==
            1);
    }
  }
}

TEST_CASE("devices with the same PCI address are recognised as the same GPU", "[registry]") {
  std::vector<DeviceInfo> devices(5);
  devices[0].pci = devices[3].pci = "0000:1b:00.0";
  devices[1].pci = "0000:1c:00.0";  // devices 2 and 4 have no address
  CHECK(same_card(devices, 0) == 0);
  CHECK(same_card(devices, 1) == 1);
  CHECK(same_card(devices, 3) == 0);
  CHECK(same_card(devices, 4) == 4);
}

}  // namespace
}  // namespace ubs
