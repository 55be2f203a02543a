// SPDX-License-Identifier: Apache-2.0
// Tests the implementation of Device in every back end: copies and their order, memory accounting, times,
// and the error for a request of memory that is too large. The sizes of the copies are below, equal to and
// above the size of one staging buffer of the CUDA back end (256 KiB). The largest copy exceeds the size of
// all eight staging buffers together.
#include <algorithm>
#include <catch2/catch.hpp>
#include <numeric>

#include "tests/support/device_fixture.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

std::vector<std::uint8_t> pattern(std::size_t size, unsigned seed) {
  std::vector<std::uint8_t> bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>((i * 2654435761u + seed) >> 13);
  return bytes;
}

TEST_CASE("uploaded data of any size can be downloaded unchanged", "[device]") {
  constexpr std::size_t kPiece = std::size_t{256} << 10;
  for (const auto& device : devices_under_test())
    for (const std::size_t size :
         {std::size_t{1}, std::size_t{4097}, kPiece - 1, kPiece, kPiece + 1, 20 * kPiece + 5}) {
      INFO(device->info().name << ", " << size << " bytes");
      Buffer<std::uint8_t> a(*device, "a", size + 3), b(*device, "b", size + 3);
      a.zero();
      std::vector<std::uint8_t> bytes = pattern(size, 1);
      a.upload(bytes, 2);
      // After upload() has returned, the source may change. This must have no effect on the uploaded data.
      std::fill(bytes.begin(), bytes.end(), std::uint8_t{0});
      device->copy(*a.view().memory, 0, *b.view().memory, 0, size + 3);
      a.upload(pattern(size, 2), 2);  // follows after the copy, so it must not affect the result of the copy
      std::vector<std::uint8_t> expected(size + 3, 0);
      const std::vector<std::uint8_t> first = pattern(size, 1), second = pattern(size, 2);
      std::copy(first.begin(), first.end(), expected.begin() + 2);
      CHECK(b.download() == expected);
      std::copy(second.begin(), second.end(), expected.begin() + 2);
      CHECK(a.download() == expected);
      device->fill_zero(*a.view().memory, 1, size);
      CHECK(a.download()[size + 1] == expected[size + 1]);
      CHECK(a.download()[size] == 0);
    }
}

TEST_CASE("a device counts its memory and rejects requests for more than it has", "[device]") {
  for (const auto& device : devices_under_test()) {
    const std::uint64_t before = device->allocated_bytes();
    {
      const Buffer<float> buffer(*device, "buffer", 1000);
      CHECK(device->allocated_bytes() == before + 4000);
      CHECK(device->peak_bytes() >= before + 4000);
    }
    CHECK(device->allocated_bytes() == before);
    const std::size_t too_much = std::size_t{1} << 50;
    const std::string message =
        test::message_of([&] { device->allocate("a large thing", too_much); }, ErrorKind::memory);
    CHECK(message.find("a large thing") != std::string::npos);
    CHECK(device->allocated_bytes() == before);
  }
}

TEST_CASE("profiling lists the kernels that ran and their number of calls", "[device]") {
  for (const auto& device : devices_under_test()) {
    Buffer<float> buffer(*device, "buffer", 100000);
    device->set_profiling(true);
    for (int i = 0; i < 3; ++i) buffer.zero();
    std::uint64_t fills = 0;
    for (const TimerEntry& entry : device->timings()) {
      CHECK(entry.device_ms >= 0);
      if (entry.name == "fill") fills = entry.calls;
    }
    CHECK(fills == 3);
    device->set_profiling(false);
    buffer.zero();
    CHECK(device->timings().empty());
  }
}

// CUDA devices compile programs at run time only for configurations whose kernels were not compiled ahead of
// time.
TEST_CASE("CUDA devices list the programs that a configuration has compiled at run time", "[device]") {
  for (const auto& device : devices_under_test()) {
    if (device->info().backend != "cuda") continue;
    const std::size_t before = device->programs().size();
    CHECK_NOTHROW(make_stages(*device, {.dim = 3, .depth = true}));
    CHECK(device->programs().size() == before);
    KernelConfig config{.dim = 3};
    config.alpha_min = 0.03125f;
    for (int twice = 0; twice < 2; ++twice) {
      make_stages(*device, config);
      const std::vector<ProgramUse> programs = device->programs();
      REQUIRE(programs.size() == before + 2);  // the projection and the rasteriser
      CHECK(std::ranges::count_if(programs, [](const ProgramUse& use) {
              return use.options.find("-DUBS_ALPHA_MIN=0x1p-5f") != std::string::npos;
            }) == 2);
    }
  }
}

}  // namespace
}  // namespace ubs
