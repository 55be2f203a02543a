// SPDX-License-Identifier: Apache-2.0
// Choosing among devices of several back ends: a card that CUDA and OpenCL both show, and a CPU.
#include "host/device/registry.hpp"

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
  return info;
}

const std::vector<DeviceInfo> kCardAndCpu{
    device("cuda", "CUDA runtime 13.0", "NVIDIA H200", DeviceType::gpu),
    device("opencl", "Portable Computing Language", "cpu-skylake", DeviceType::cpu),
    device("opencl", "NVIDIA CUDA", "NVIDIA H200", DeviceType::gpu),
};

TEST_CASE("vectors decide the rasteriser, and not the type of the device", "[registry]") {
  DeviceInfo cpu = kCardAndCpu[1];
  cpu.float_vector_width = 16;
  CHECK(raster_kind("auto", cpu) == RasterKind::cpu);
  cpu.float_vector_width = 1;  // as of llvmpipe
  CHECK(raster_kind("auto", cpu) == RasterKind::gpu);
  CHECK(raster_kind("cpu", cpu) == RasterKind::cpu);
  CHECK(raster_kind("auto", kCardAndCpu[0]) == RasterKind::gpu);
  CHECK_THROWS_AS(raster_kind("cpu", kCardAndCpu[0]), Error);  // CUDA has one
}

TEST_CASE("a device is found by index, type, back end and name", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  const auto chosen = [](const char* request) { return choose_device(kCardAndCpu, request); };
  CHECK(chosen("") == 0);
  CHECK(chosen("gpu") == 0);
  CHECK(chosen("H200") == 0);
  CHECK(chosen("cuda") == 0);  // although a part of the OpenCL platform's name
  CHECK(chosen("CUDA:h200") == 0);
  CHECK(chosen("cpu") == 1);
  CHECK(chosen("portable") == 1);
  CHECK(chosen("opencl") == 2);  // its first GPU
  CHECK(chosen("opencl:h200") == 2);
  CHECK(chosen("opencl:cpu") == 1);
  CHECK(chosen("opencl:gpu") == 2);
  CHECK(chosen("2") == 2);
  CHECK(chosen("opencl:1") == 2);  // its second device
  CHECK(chosen("200") == 0);       // of a name
}

TEST_CASE("without a request there are further devices to try: GPUs first", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  using Places = std::vector<std::size_t>;
  CHECK(device_candidates(kCardAndCpu, "") == Places{0, 2, 1});
  CHECK(device_candidates(kCardAndCpu, "gpu") == Places{0});
  ::setenv("UBS_DEVICE", "cpu", 1);
  CHECK(device_candidates(kCardAndCpu, "") == Places{1});
  ::unsetenv("UBS_DEVICE");
}

TEST_CASE("without CUDA the same words choose OpenCL devices or fail", "[registry]") {
  ::unsetenv("UBS_DEVICE");
  const std::vector<DeviceInfo> devices(kCardAndCpu.begin() + 1, kCardAndCpu.end());
  CHECK(choose_device(devices, "") == 1);
  CHECK(choose_device(devices, "H200") == 1);
  for (const char* request :
       {"cuda", "cuda:H200", "opencl:A100", "2", "opencl:2", "12345678901234567890", "quantum"}) {
    const std::string message = test::message_of([&] { choose_device(devices, request); }, ErrorKind::device);
    INFO(request);
    CHECK(message.find(request) != std::string::npos);
    CHECK(message.find("0: cpu-skylake") != std::string::npos);
  }
  CHECK(!test::message_of([] { choose_device({}, ""); }, ErrorKind::device).empty());
}

TEST_CASE("UBS_DEVICE decides where nothing is asked for", "[registry]") {
  ::setenv("UBS_DEVICE", "opencl:cpu", 1);
  CHECK(choose_device(kCardAndCpu, "") == 1);
  CHECK(choose_device(kCardAndCpu, "gpu") == 0);
  ::setenv("UBS_DEVICE", "quantum", 1);
  CHECK(
      test::message_of([] { choose_device(kCardAndCpu, ""); }, ErrorKind::device).starts_with("UBS_DEVICE"));
  ::unsetenv("UBS_DEVICE");
}

TEST_CASE("rasterisers are told which spatial kernel, also one that they do not have", "[registry]") {
  const auto options = [](int kernel) {
    return raster_options({.variant = {.kernel = static_cast<SpatialKernel>(kernel)}});
  };
  CHECK(options(0) == Options{});
  CHECK(options(1) == Options{"-DUBS_FALLOFF=1"});
  CHECK(options(2) == Options{"-DUBS_FALLOFF=2"});  // kernels/variant.h refuses it
}

TEST_CASE("views of one card are told by its PCI address", "[registry]") {
  std::vector<DeviceInfo> devices(5);
  devices[0].pci = devices[3].pci = "0000:1b:00.0";
  devices[1].pci = "0000:1c:00.0";  // the other two do not say
  CHECK(same_card(devices, 0) == 0);
  CHECK(same_card(devices, 1) == 1);
  CHECK(same_card(devices, 3) == 0);
  CHECK(same_card(devices, 4) == 4);
}

}  // namespace
}  // namespace ubs
