// SPDX-License-Identifier: Apache-2.0
// CudaDevice is one CUDA device with a stream that executes all work in order, except for the uploads of
// copy_async(), which have a stream of their own. The class allocates memory, copies data, launches kernels
// with arguments whose types the C++ compiler checks, and measures times.
#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "cuda_backend/compiler.hpp"
#include "cuda_backend/cuda_api.hpp"
#include "cuda_backend/cuda_tuning.hpp"
#include "cuda_backend/device_algorithms.hpp"
#include "cuda_backend/module.hpp"
#include "cuda_backend/staging.hpp"
#include "host/device/device.hpp"

namespace ubs::cuda {

class CudaDevice;

// CudaMemory is a buffer on a device. The memory statistics of the device include it as long as it exists.
class CudaMemory final : public Memory {
 public:
  CudaMemory(CudaDevice& device, std::string label, std::size_t bytes);
  ~CudaMemory() override;
  CudaMemory(const CudaMemory&) = delete;
  CudaMemory& operator=(const CudaMemory&) = delete;
  void* pointer() const { return pointer_; }
  DeviceAddress address() const override;

 private:
  CudaDevice& device_;
  void* pointer_ = nullptr;
};

template <typename T>
T* pointer_of(const BufferView<T>& view) {
  return view.memory ? static_cast<T*>(static_cast<CudaMemory*>(view.memory)->pointer()) : nullptr;
}

class CudaDevice final : public Device, public TunableDevice {
 public:
  // Reduces info().memory_bytes to the memory that is free now, because other programs may also use the GPU.
  CudaDevice(int ordinal, DeviceInfo info);
  ~CudaDevice() override;

  const DeviceInfo& info() const override { return info_; }
  std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) override;
  void write(Memory& to, std::size_t offset, std::span<const std::byte> from) override;
  void read(const Memory& from, std::size_t offset, std::span<std::byte> to) override;
  std::unique_ptr<PendingRead> read_later(const Memory& from, std::size_t offset, std::size_t bytes) override;
  void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
            std::size_t bytes) override;
  void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) override;
  void copy_async(Memory& to, std::span<const std::byte> from) override;
  void join_uploads() override;
  void finish() override;
  void set_profiling(bool on) override;
  std::vector<TimerEntry> timings() const override;
  // Returns the programs that were compiled at run time.
  std::vector<ProgramUse> programs() const override;
  std::unique_ptr<Stages> make_stages(const KernelConfig& config) override;
  std::unique_ptr<MetricOps> make_metric_ops() override;
  TunableDevice* tunable() override { return this; }

  TunedTable tuned_constants() const override { return cuda::tuned_constants(); }
  void set_tuning(TuningValues values) override { info_.tuning = std::move(values); }

  // Enqueues a kernel. Views are converted to pointers; every other argument must have the exact type of the
  // kernel's parameter, otherwise the call does not compile. A grid without blocks launches nothing.
  template <typename... Parameters, typename... Arguments>
  void launch(const char* name, const Kernel<void(Parameters...)>& kernel, dim3 grid, dim3 block,
              const Arguments&... arguments) {
    static_assert(sizeof...(Parameters) == sizeof...(Arguments),
                  "the number of arguments differs from the number of parameters of the kernel");
    if (!kernel.symbol && !kernel.function)
      fail(ErrorKind::internal, "no program contains the kernel '{}'", name);
    if (grid.x == 0 || grid.y == 0 || grid.z == 0) return;
    std::tuple<Parameters...> values{argument<Parameters>(arguments)...};
    std::array<void*, sizeof...(Parameters)> addresses =
        std::apply([](auto&... each) { return std::array<void*, sizeof...(each)>{&each...}; }, values);
    timed(name, [&] {
      return kernel.symbol ? cudaLaunchKernel(kernel.symbol, grid, block, addresses.data(), 0, stream_.get())
                           : launch_function(kernel.function, grid, block, addresses.data(), stream_.get());
    });
  }
  // Runs a function of device_algorithms.hpp: the first call queries the size of its scratch memory, the
  // second one does the work. Example:
  //   algorithm("sort", [&](Workspace& w) { return sort_pairs(w, ...); });
  template <typename Call>
  void algorithm(const char* name, const Call& call) {
    Workspace workspace;
    check(call(workspace), name);
    workspace.data = scratch(workspace.bytes);
    timed(name, [&] { return call(workspace); });
  }

  // Runs a library call that enqueues work on stream(). It is timed and named like a launch.
  template <typename Call>
  void call(const char* name, const Call& enqueue) {
    timed(name, enqueue);
  }

  // Compiles and loads a program at its first use and keeps it until the device is destroyed.
  const Module& module(const ProgramSpec& spec);

  cudaStream_t stream() const { return stream_.get(); }
  void make_current() const { check(cudaSetDevice(ordinal_), "cudaSetDevice"); }

 private:
  friend class CudaMemory;

  template <typename Parameter, typename T>
  static Parameter argument(const BufferView<T>& view) {
    return pointer_of(view);
  }
  template <typename Parameter, typename T>
  requires kKernelValue<T>
  static Parameter argument(const T& value) {
    static_assert(std::is_same_v<Parameter, T>,
                  "the type of an argument differs from the type of the kernel's parameter");
    return value;
  }
  template <typename Parameter, typename T>
  static Parameter argument(T* const& pointer) {
    return pointer;
  }

  // Makes an asynchronous call. When profiling is on, records an event before and one after the call. If the
  // call fails, the error message contains `name`.
  template <typename Call>
  void timed(const char* name, const Call& call) {
    make_current();
    const auto begin = start_timer();
    const cudaError_t code = call();
    finish_call(name, code, begin);
  }
  cudaEvent_t start_timer();
  void finish_call(const char* name, cudaError_t code, cudaEvent_t begin);
  void collect() const;
  void* scratch(std::size_t bytes);

  struct Interval {
    std::string name;
    EventHandle begin, end;
  };
  struct LoadedProgram {
    ProgramUse use;
    std::unique_ptr<Module> module;
  };
  int ordinal_, capability_ = 0;
  DeviceInfo info_;
  bool profiling_ = false, synchronous_ = false;
  StreamHandle stream_, upload_stream_;
  std::unique_ptr<Staging> staging_;
  UploadRing uploads_;
  ReadBlocks reads_;
  EventHandle given_;  // marks the work enqueued before a copy_async(), for which the upload must wait
  std::unique_ptr<Memory> scratch_;
  EventHandle open_timer_;
  std::map<std::string, LoadedProgram> modules_;  // the key consists of the file and the sorted options
  mutable std::vector<Interval> pending_;
  mutable std::map<std::string, TimerEntry> timings_;
};

}  // namespace ubs::cuda
