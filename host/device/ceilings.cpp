// SPDX-License-Identifier: Apache-2.0
#include "host/device/ceilings.hpp"

#include <algorithm>
#include <functional>

#include "host/base/stopwatch.hpp"

namespace ubs {
namespace {

constexpr std::size_t kChains = 12;  // kChains of kernels/map/ceilings.cl
// Level-2 caches hold 512 KiB a core on CPUs of the last years (half of it is used here), GPUs several MiB.
constexpr std::size_t kCpuCacheBytes = 256 << 10, kGpuCacheBytes = 4 << 20;

constexpr std::size_t kMinVectors = 4;  // that a work-item reads

enum class Stream { read, write, update };

class Measurement {
 public:
  Measurement(Device& device, CeilingKernels& kernels, const CeilingLimits& limits)
      : device_(device),
        kernels_(kernels),
        limits_(limits),
        lanes_(kernels.lanes()),
        on_cpu_(device.info().type == DeviceType::cpu) {
    const std::size_t units = device.info().compute_units;
    group_ = on_cpu_ ? 1 : 256;
    items_ = on_cpu_ ? 4 * units : 256 * 16 * units;
    out_ = Buffer<float>(device, "ceiling results", items_ * lanes_);
    const std::size_t most =
        std::min(limits.large_bytes, static_cast<std::size_t>(device.info().max_allocation_bytes / 2));
    const std::size_t per_item = std::max(kMinVectors, most / vector_bytes() / kMinVectors * kMinVectors);
    large_ = Buffer<float>(device, "ceiling stream", per_item * items_ * lanes_);
    large_.zero();
  }

  CeilingRates measure() {
    CeilingRates rates;
    rates.fma = fma();
    rates.read = stream(Stream::read, large_bytes(), 1);
    rates.write = stream(Stream::write, large_bytes(), 1);
    rates.update = stream(Stream::update, large_bytes(), 1);
    rates.private_cache_bytes =
        std::max(kMinVectors * vector_bytes(),
                 on_cpu_ ? kCpuCacheBytes * device_.info().compute_units : kGpuCacheBytes);
    rates.private_cache = stream(Stream::read, rates.private_cache_bytes, on_cpu_ ? 500 : 50);
    const std::size_t shared = kernels_.shared_cache();
    if (shared < 2 * rates.private_cache_bytes || shared > large_bytes()) return rates;
    rates.shared_cache_bytes = shared;
    rates.shared_cache = stream(Stream::update, shared / 2, 8);
    return rates;
  }

 private:
  // Nanoseconds of the fastest run, so that work / time is in giga.
  double best(const std::function<void()>& launch) {
    launch();
    device_.finish();
    double fastest = 1e30;
    for (int i = 0; i < limits_.repetitions; ++i) {
      const Stopwatch watch;
      launch();
      device_.finish();
      fastest = std::min(fastest, 1e9 * watch.seconds());
    }
    return std::max(fastest, 1.0);
  }

  double fma() {
    const std::uint32_t long_enough = on_cpu_ ? 1u << 18 : 1u << 14;
    const CeilingLaunch launch{.items = items_,
                               .group = group_,
                               .rounds = limits_.fma_rounds > 0 ? limits_.fma_rounds : long_enough};
    const double flops = 2.0 * static_cast<double>(kChains * lanes_ * items_) * launch.rounds;
    return flops / best([&] { kernels_.fma(launch, out_.view(), 0.999f); });
  }

  std::size_t vector_bytes() const { return sizeof(float) * lanes_ * items_; }  // of all work-items
  std::size_t large_bytes() const { return large_.size() * sizeof(float); }

  // GB/s over the first `bytes` of the large buffer, again and again for `rounds`.
  double stream(Stream kind, std::size_t bytes, std::uint32_t rounds) {
    const std::size_t vectors = std::min(bytes, large_bytes()) / vector_bytes() / kMinVectors * kMinVectors;
    const auto count = static_cast<std::uint32_t>(std::max(kMinVectors, vectors));
    const CeilingLaunch launch{.items = items_,
                               .group = group_,
                               .spacing = on_cpu_ ? count : 1,
                               .step = on_cpu_ ? 1 : static_cast<std::uint32_t>(items_),
                               .count = count,
                               .rounds = rounds};
    const double once = static_cast<double>(vector_bytes()) * count * rounds;
    if (kind == Stream::read) return once / best([&] { kernels_.read(launch, large_.view(), out_.view()); });
    if (kind == Stream::write) return once / best([&] { kernels_.write(launch, large_.view(), 0.5f); });
    return 2 * once / best([&] { kernels_.update(launch, large_.view(), 0.5f); });
  }

  Device& device_;
  CeilingKernels& kernels_;
  CeilingLimits limits_;
  std::size_t lanes_;
  bool on_cpu_;
  std::size_t group_ = 1, items_ = 1;
  Buffer<float> out_, large_;
};

}  // namespace

CeilingRates measure_ceilings(Device& device, CeilingKernels& kernels, const CeilingLimits& limits) {
  return Measurement(device, kernels, limits).measure();
}

}  // namespace ubs
