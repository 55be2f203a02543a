// SPDX-License-Identifier: Apache-2.0
// CUDA graphs with the runtime of tests/cuda, where recorded work runs when its graph is launched and a call
// that must not be made meanwhile spoils the recording.
#include "cuda_backend/launch_graph.hpp"

#include <catch2/catch.hpp>

#include "cuda_backend/platform.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

constexpr unsigned kThreads = 32;

__global__ void add(float* values, float amount) { values[threadIdx.x] += amount; }
__global__ void scale(float* values, float factor) { values[threadIdx.x] *= factor; }

struct Bench {
  std::unique_ptr<Device> opened = cuda::open_device(0);
  cuda::CudaDevice& device = dynamic_cast<cuda::CudaDevice&>(*opened);
  Buffer<float> values{device, "values", kThreads};
  std::unique_ptr<LaunchGraph> graph = device.make_launch_graph();

  Bench() {
    values.zero();
    for (int i = 0; i < 2; ++i) graph->give([] {});  // the calls that are not recorded
  }
  void give_add(float amount) {
    device.launch("add", cuda::Kernel<void(float*, float)>(add), 1, kThreads, values.view(), amount);
  }
  void give_scale(float factor) {
    device.launch("scale", cuda::Kernel<void(float*, float)>(scale), 1, kThreads, values.view(), factor);
  }
  float first() { return values.download()[0]; }
};

TEST_CASE("a launch graph runs its work in its place", "[cuda]") {
  Bench b;
  b.give_add(1);
  b.graph->give([&] {
    b.give_add(1);
    b.give_scale(10);
  });
  b.give_add(3);
  CHECK(b.first() == 23);
  CHECK(b.graph->counts().given == 3);
  CHECK(b.graph->counts().launched == 1);
}

TEST_CASE("a launch graph takes over other numbers and is made anew for other work", "[cuda]") {
  Bench b;
  for (int i = 1; i <= 3; ++i) b.graph->give([&] { b.give_add(static_cast<float>(i)); });
  CHECK(b.first() == 6);
  CHECK(b.graph->counts().launched == 3);
  CHECK(b.graph->counts().made == 1);
  Buffer<float> larger(b.device, "values", 2 * kThreads);
  larger.zero();
  std::swap(b.values, larger);
  b.graph->give([&] { b.give_add(5); });
  CHECK(b.first() == 5);
  CHECK(b.graph->counts().made == 1);
  b.graph->give([&] {
    b.give_scale(2);
    b.give_add(1);
  });
  CHECK(b.first() == 11);
  CHECK(b.graph->counts().made == 2);
}

TEST_CASE("what cannot be recorded ends the recording, and all of the work is done", "[cuda]") {
  Bench b;
  SECTION("a read sees what was given before it") {
    float seen = 0;
    b.graph->give([&] {
      b.give_add(2);
      seen = b.first();
      b.give_add(5);
    });
    CHECK(seen == 2);
    CHECK(b.first() == 7);
  }
  SECTION("memory is made and freed") {
    b.graph->give([&] {
      b.give_add(2);
      Buffer<float> other(b.device, "other", kThreads);
      b.device.copy(*b.values.view().memory, 0, *other.view().memory, 0, sizeof(float) * kThreads);
      b.give_add(1);
    });
    CHECK(b.first() == 3);
  }
  SECTION("memory is freed") {
    Buffer<float> other(b.device, "other", kThreads);
    b.graph->give([&] {
      b.device.copy(*b.values.view().memory, 0, *other.view().memory, 0, sizeof(float) * kThreads);
      other = {};
      b.give_add(1);
    });
    CHECK(b.first() == 1);
  }
  SECTION("uploads") {
    const std::vector<float> fours(kThreads, 4.0f);
    b.graph->give([&] {
      b.give_add(2);
      b.values.upload(fours);
      b.give_add(1);
      b.device.upload_beside(*b.values.view().memory, std::as_bytes(std::span(fours)));
      b.device.join_uploads();
    });
    CHECK(b.first() == 4);
  }
  CHECK(b.graph->counts().launched == 0);
  b.values.zero();
  b.graph->give([&] { b.give_add(1); });  // and the next time is recorded again
  CHECK(b.first() == 1);
  CHECK(b.graph->counts().launched == 1);
}

TEST_CASE("a late read of recorded work", "[cuda]") {
  Bench b;
  for (const float amount : {1.0f, 2.0f, 3.0f}) {
    std::unique_ptr<PendingRead> read;
    b.values.zero();
    b.graph->give([&] {
      b.give_add(amount);
      read = b.device.read_later(*b.values.view().memory, 0, sizeof(float));
      b.give_add(10);
    });
    float value = 0;
    std::memcpy(&value, read->wait().data(), sizeof value);
    CHECK(value == amount);
  }
  CHECK(b.graph->counts().launched == 2);  // the first one made pinned memory
}

TEST_CASE("profiled work is not recorded", "[cuda]") {
  Bench b;
  b.device.set_profiling(true);
  b.graph->give([&] { b.give_add(1); });
  const std::vector<TimerEntry> timings = b.device.timings();
  CHECK(std::ranges::count(timings, "add", &TimerEntry::name) == 1);
  b.device.set_profiling(false);
  CHECK(b.graph->counts().launched == 0);
  CHECK(b.first() == 1);
}

TEST_CASE("a launch graph that fails says so, and the device goes on", "[cuda]") {
  Bench b;
  const auto go_on = [&] {
    b.values.zero();
    b.graph->give([&] { b.give_add(1); });
    CHECK(b.first() == 1);
  };
  SECTION("the device does not take it") {
    cuda_on_host::refused_graph = cudaErrorInvalidValue;
    CHECK(test::message_of([&] { b.graph->give([&] { b.give_add(1); }); }, ErrorKind::device) ==
          "launch graph on CUDA on the host: cudaGraphInstantiate failed with cudaError: error on the host; "
          "leave out "
          "launch_graph");
    go_on();
  }
  SECTION("nor a part of it, when memory is freed") {
    Buffer<float> other(b.device, "other", kThreads);
    cuda_on_host::refused_graph = cudaErrorMemoryAllocation;
    CHECK(test::message_of(
              [&] {
                b.graph->give([&] {
                  b.give_add(1);
                  other = {};
                });
              },
              ErrorKind::memory)
              .find("cudaGraphInstantiate") != std::string::npos);
    go_on();
  }
  SECTION("a call that must not be made is told at the next launch") {
    CHECK(test::message_of(
              [&] {
                b.graph->give([&] {
                  cudaStreamSynchronize(b.device.stream());
                  b.give_add(1);
                });
              },
              ErrorKind::device)
              .find("'add' on CUDA on the host failed with cudaError: error on the host while it was "
                    "recorded; leave out "
                    "launch_graph") != std::string::npos);
    go_on();
  }
  SECTION("or at the end") {
    CHECK(test::message_of([&] { b.graph->give([&] { cudaStreamSynchronize(b.device.stream()); }); },
                           ErrorKind::device)
              .find("cudaStreamEndCapture") != std::string::npos);
    go_on();
  }
  SECTION("another error drops what was recorded") {
    CHECK_THROWS_WITH(b.graph->give([&] {
      b.give_add(1);
      fail(ErrorKind::data, "no image");
    }),
                      "no image");
    CHECK(b.first() == 0);
    go_on();
  }
}

}  // namespace
}  // namespace ubs
