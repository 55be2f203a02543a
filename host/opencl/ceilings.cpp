// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/ceilings.hpp"

#include <algorithm>
#include <chrono>
#include <functional>

#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {
namespace {

constexpr std::size_t kChains = 12;  // UBS_CHAINS of kernels/opencl/ceilings.cl
// Level-2 caches hold 512 KiB a core on CPUs of the last years (half of it is used here), GPUs several MiB.
constexpr std::size_t kCpuCacheBytes = 256 << 10, kGpuCacheBytes = 4 << 20;

class Ceilings {
 public:
  Ceilings(OpenclDevice& device, const CeilingLimits& limits)
      : device_(device),
        limits_(limits),
        lanes_(device.vector_width()),
        kernels_(device, {{"opencl/ceilings.cl"}, {"-DUBS_VW=" + std::to_string(device.vector_width())}}),
        on_cpu_(device.info().type == DeviceType::cpu) {
    const std::size_t units = device.info().compute_units;
    group_ = on_cpu_ ? 1 : 256;
    items_ = on_cpu_ ? 4 * units : 256 * 16 * units;
    out_ = Buffer<float>(device, "ceiling results", items_ * lanes_);
    const std::size_t most =
        std::min(limits.large_bytes, static_cast<std::size_t>(device.info().max_allocation_bytes / 2));
    per_item_ = std::max<std::size_t>(4, most / (4 * lanes_ * items_) / 4 * 4);
    large_ = Buffer<float>(device, "ceiling stream", per_item_ * items_ * lanes_);
    large_.zero();
  }

  CeilingRates measure() {
    CeilingRates rates;
    rates.fma = fma();
    rates.read = stream("ceiling_read", large_bytes(), 1);
    rates.write = stream("ceiling_write", large_bytes(), 1);
    rates.update = stream("ceiling_update", large_bytes(), 1);
    rates.private_cache_bytes = on_cpu_ ? kCpuCacheBytes * device_.info().compute_units : kGpuCacheBytes;
    rates.private_cache = stream("ceiling_read", rates.private_cache_bytes, on_cpu_ ? 500 : 50);
    cl_ulong shared = 0;
    check(clGetDeviceInfo(device_.id(), CL_DEVICE_GLOBAL_MEM_CACHE_SIZE, sizeof shared, &shared, nullptr),
          "clGetDeviceInfo");
    if (shared < 2 * rates.private_cache_bytes || shared > large_bytes()) return rates;
    rates.shared_cache_bytes = static_cast<std::size_t>(shared);
    rates.shared_cache = stream("ceiling_update", rates.shared_cache_bytes / 2, 8);
    return rates;
  }

 private:
  // Nanoseconds of the fastest run, so that work / time is in giga.
  double best(const std::function<void()>& launch) {
    using Clock = std::chrono::steady_clock;
    launch();
    device_.finish();
    double fastest = 1e30;
    for (int i = 0; i < limits_.repetitions; ++i) {
      const auto start = Clock::now();
      launch();
      device_.finish();
      fastest = std::min(fastest, std::chrono::duration<double, std::nano>(Clock::now() - start).count());
    }
    return std::max(fastest, 1.0);
  }

  double fma() {
    const std::uint32_t rounds = on_cpu_ ? 1u << 18 : 1u << 14;
    const double flops = 2.0 * static_cast<double>(kChains * lanes_ * items_) * rounds;
    return flops / best([&] { kernels_["ceiling_fma"]({items_}, {group_}, out_.view(), rounds, 0.999f); });
  }

  std::size_t large_bytes() const { return large_.size() * sizeof(float); }

  // GB/s of a kernel over the first `bytes` of the large buffer, again and again for `rounds`.
  double stream(const std::string& kernel, std::size_t bytes, std::uint32_t rounds) {
    const std::size_t vectors = std::min(bytes, large_bytes()) / (sizeof(float) * lanes_ * items_) / 4 * 4;
    const auto count = static_cast<std::uint32_t>(std::max<std::size_t>(4, vectors));
    const std::uint32_t spacing = on_cpu_ ? count : 1,
                        step = on_cpu_ ? 1 : static_cast<std::uint32_t>(items_);
    const double once = static_cast<double>(sizeof(float) * lanes_ * items_) * count * rounds;
    Kernel& run = kernels_[kernel];
    const Range items{items_}, group{group_};
    if (kernel == "ceiling_read")
      return once /
             best([&] { run(items, group, large_.view(), out_.view(), spacing, step, count, rounds); });
    if (kernel == "ceiling_write")
      return once / best([&] { run(items, group, large_.view(), spacing, step, count, 0.5f); });
    return 2 * once / best([&] { run(items, group, large_.view(), spacing, step, count, 0.5f, rounds); });
  }

  OpenclDevice& device_;
  CeilingLimits limits_;
  std::size_t lanes_;
  KernelSet kernels_;
  bool on_cpu_;
  std::size_t group_ = 1, items_ = 1, per_item_ = 1;
  Buffer<float> out_, large_;
};

}  // namespace

CeilingRates measure_ceilings(Device& device, const CeilingLimits& limits) {
  auto* opencl_device = dynamic_cast<OpenclDevice*>(&device);
  if (!opencl_device) fail(ErrorKind::internal, "{} is no OpenCL device", device.info().name);
  return Ceilings(*opencl_device, limits).measure();
}

}  // namespace ubs::opencl
