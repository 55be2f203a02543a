// SPDX-License-Identifier: Apache-2.0
// Tests which GPUs the CUDA back end lists, and which messages it prints about GPUs that it does not list.
#include <cuda_runtime.h>

#include <catch2/catch.hpp>

#include "cuda_backend/cuda_platform.hpp"
#include "host/base/error.hpp"
#include "tests/support/on_stderr.hpp"

namespace ubs {
namespace {

struct OtherCard {
  explicit OtherCard(const cuda_on_host::Card& other) { cuda_on_host::card = other; }
  ~OtherCard() { cuda_on_host::card = {}; }
};

// Lists the devices twice and returns the text that is printed. A process may list devices several times, and
// both lists must have the same length. Each message is printed only once per process, so each test causes a
// different message.
std::string remarks_of_listing(std::size_t devices) {
  return test::on_stderr([&] {
    for (int i = 0; i < 2; ++i) CHECK(cuda::list_devices().size() == devices);
  });
}

TEST_CASE("no messages are printed without a driver, without a GPU, and for a supported GPU", "[cuda]") {
  SECTION("no driver") {
    const OtherCard card({.runtime = 13000, .count = cudaErrorInsufficientDriver});
    CHECK(remarks_of_listing(0).empty());
  }
  SECTION("no GPU") {
    const OtherCard card({.driver = 13000, .runtime = 13000, .count = cudaErrorNoDevice});
    CHECK(remarks_of_listing(0).empty());
  }
  SECTION("a GPU for which the build has machine code is listed without opening it") {
    for (const int capability : {80, 86, 90}) {
      const OtherCard card({.capability = capability, .code = cudaErrorInvalidValue});
      CHECK(remarks_of_listing(1).empty());
    }
  }
}

TEST_CASE("the reason why there are no CUDA devices is printed once", "[cuda]") {
  SECTION("the driver is too old") {
    const OtherCard card({.driver = 12040, .runtime = 13010, .count = cudaErrorInsufficientDriver});
    CHECK(
        remarks_of_listing(0) ==
        "ubs: warning: no CUDA devices: the driver supports CUDA 12.4, but this build needs 13.0: update the "
        "driver, or use --device opencl\n");
  }
  SECTION("another error") {
    const OtherCard card({.driver = 13000, .runtime = 13010, .count = cudaErrorInvalidValue});
    CHECK(remarks_of_listing(0) == "ubs: warning: no CUDA devices: cudaError: error on the host\n");
  }
  SECTION("the properties of the GPU cannot be read") {
    const OtherCard card({.driver = 13000, .runtime = 13000, .properties = cudaErrorInvalidValue});
    CHECK(remarks_of_listing(0) == "ubs: warning: CUDA device 0 is not used: cudaError: error on the host\n");
  }
}

TEST_CASE("a GPU for which the build has no code is not listed, and the reason is printed", "[cuda]") {
  SECTION("the GPU is older than the Turing generation") {
    const OtherCard card({.capability = 70});
    CHECK(
        remarks_of_listing(0) ==
        "ubs: warning: CUDA on the host (CUDA device 0, sm_70) is not used: the CUDA back end requires sm_75 "
        "or newer\n");
  }
  SECTION("no machine code, and the driver does not compile any") {
    const OtherCard card({.capability = 110, .code = cudaErrorNoKernelImageForDevice});
    CHECK(remarks_of_listing(0) ==
          "ubs: warning: CUDA on the host (CUDA device 0, sm_110) is not used: this build (sm_80, sm_90) has "
          "no code for this GPU (cudaError: error on the host): configure with "
          "-DCMAKE_CUDA_ARCHITECTURES=110\n");
  }
  SECTION("no machine code, but the driver compiles it") {
    const OtherCard card({.capability = 120});
    CHECK(remarks_of_listing(1).empty());
    CHECK(cuda::open_device(0)->info().version == "sm_120");
  }
  SECTION("the machine code does not run, which is detected when the GPU is opened") {
    const OtherCard card({.capability = 90, .code = cudaErrorNoKernelImageForDevice});
    CHECK(remarks_of_listing(1).empty());
    const std::string message = test::message_of([] { cuda::open_device(0); }, ErrorKind::device);
    CHECK(message.find("CMAKE_CUDA_ARCHITECTURES=90") != std::string::npos);
  }
}

TEST_CASE("the memory of an opened GPU excludes the memory that other programs use", "[cuda]") {
  const std::uint64_t all = cuda::open_device(0)->info().memory_bytes;
  const OtherCard card({.used = std::size_t{all} / 4});
  const DeviceInfo listed = cuda::list_devices().at(0);
  CHECK(listed.memory_bytes == all);
  const std::unique_ptr<Device> opened = cuda::open_device(0);
  CHECK(opened->info().memory_bytes == all - all / 4);
  CHECK(opened->info().max_allocation_bytes == all - all / 4);
}

}  // namespace
}  // namespace ubs
