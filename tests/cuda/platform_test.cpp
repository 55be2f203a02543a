// SPDX-License-Identifier: Apache-2.0
// Tests which cards the CUDA back end offers, and what it reports about the others.
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

// Lists the devices twice, because a process lists them several times and this must make no difference. Each
// message is printed once per process, so each test uses different numbers.
std::string remarks_of_listing(std::size_t devices) {
  return test::on_stderr([&] {
    for (int i = 0; i < 2; ++i) CHECK(cuda::list_devices().size() == devices);
  });
}

TEST_CASE("without a driver or a card there are no CUDA devices and no remarks", "[cuda]") {
  SECTION("no driver") {
    const OtherCard card({.runtime = 13000, .count = cudaErrorInsufficientDriver});
    CHECK(remarks_of_listing(0).empty());
  }
  SECTION("no card") {
    const OtherCard card({.driver = 13000, .runtime = 13000, .count = cudaErrorNoDevice});
    CHECK(remarks_of_listing(0).empty());
  }
  SECTION("a card with matching machine code is not opened") {
    for (const int capability : {80, 86, 90}) {
      const OtherCard card({.capability = capability, .code = cudaErrorInvalidValue});
      CHECK(remarks_of_listing(1).empty());
    }
  }
}

TEST_CASE("the reason for having no CUDA devices is reported once", "[cuda]") {
  SECTION("driver too old") {
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
  SECTION("a card that does not respond") {
    const OtherCard card({.driver = 13000, .runtime = 13000, .properties = cudaErrorInvalidValue});
    CHECK(remarks_of_listing(0) == "ubs: warning: CUDA device 0 is not used: cudaError: error on the host\n");
  }
}

TEST_CASE("a card for which the build has no code is skipped, with the reason", "[cuda]") {
  SECTION("before Turing") {
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
          "no code for it (cudaError: error on the host): configure with "
          "-DCMAKE_CUDA_ARCHITECTURES=110\n");
  }
  SECTION("no machine code, but the driver compiles it") {
    const OtherCard card({.capability = 120});
    CHECK(remarks_of_listing(1).empty());
    CHECK(cuda::open_device(0)->info().version == "sm_120");
  }
  SECTION("the error is detected when the card is opened") {
    const OtherCard card({.capability = 90, .code = cudaErrorNoKernelImageForDevice});
    CHECK(remarks_of_listing(1).empty());
    const std::string message = test::message_of([] { cuda::open_device(0); }, ErrorKind::device);
    CHECK(message.find("CMAKE_CUDA_ARCHITECTURES=90") != std::string::npos);
  }
}

TEST_CASE("the memory of a card excludes the memory that other programs use", "[cuda]") {
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
