// SPDX-License-Identifier: Apache-2.0
// Tests uploads on a separate stream with the CUDA runtime of tests/cuda. The main stream, the upload stream
// or both of them run their work as late as CUDA allows. An upload must not delay later work, must not start
// before earlier work has ended, and must be complete after join_uploads().
#include <catch2/catch.hpp>

#include "cuda_backend/cuda_device.hpp"
#include "cuda_backend/cuda_platform.hpp"

namespace ubs {
namespace {

constexpr unsigned kThreads = 32;

__global__ void add(float* values, const float* others) { values[threadIdx.x] += others[threadIdx.x]; }

struct Bench {
  std::unique_ptr<Device> opened = cuda::open_device(0);
  cuda::CudaDevice& device = dynamic_cast<cuda::CudaDevice&>(*opened);
  Buffer<float> image{device, "image", kThreads}, sum{device, "sum", kThreads};

  Bench() {
    sum.zero();
    image.upload(std::vector<float>(kThreads, 1.0f));
    device.finish();
  }
  ~Bench() { cuda_on_host::is_late = usual; }

  void let_late(bool queue, bool uploads) {
    cuda_on_host::is_late = [=, main = device.stream()](cudaStream_t stream) {
      return stream == main ? queue : uploads;
    };
  }
  void copy_async(float value) {
    std::vector<float> values(kThreads, value);
    device.copy_async(*image.view().memory, std::as_bytes(std::span<const float>(values)));
    // The caller may change the values as soon as copy_async() has returned. The upload must not be affected.
    values.assign(kThreads, -100.0f);
  }
  void give_add() {
    device.launch("add", cuda::Kernel<void(float*, const float*)>(add), 1, kThreads, sum.view(),
                  image.view());
  }
  float first_sum() { return sum.download()[0]; }

 private:
  std::function<bool(cudaStream_t)> usual = cuda_on_host::is_late;
};

TEST_CASE("an upload on a separate stream does not delay later work", "[cuda]") {
  Bench b;
  b.let_late(false, true);
  b.copy_async(2);
  b.give_add();
  CHECK(b.first_sum() == 1);  // the addition has ended although the upload has not been done yet
  b.device.join_uploads();
  b.give_add();
  CHECK(b.first_sum() == 3);
}

TEST_CASE("an upload on a separate stream waits for earlier work", "[cuda]") {
  Bench b;
  b.let_late(true, false);
  b.give_add();
  b.copy_async(2);
  b.device.join_uploads();
  b.give_add();
  CHECK(b.first_sum() == 3);
}

TEST_CASE("uploads on a separate stream arrive unchanged and in order if both streams are late", "[cuda]") {
  Bench b;
  b.let_late(true, true);
  for (int i = 1; i <= 5; ++i) {
    b.copy_async(static_cast<float>(i));
    b.copy_async(static_cast<float>(10 * i));
    b.device.join_uploads();
    b.give_add();
  }
  CHECK(b.first_sum() == 150);
}

}  // namespace
}  // namespace ubs
