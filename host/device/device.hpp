// SPDX-License-Identifier: Apache-2.0
// Device is the lower one of the two layers between the pipeline and a back end; the upper one is Stages
// (stages.hpp). A Device manages memory and copies. All work that is enqueued on a device runs in the order
// in which it was enqueued, except for the copies of copy_async().
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/memory_kind.hpp"

namespace ubs {

enum class DeviceType { cpu, gpu, accelerator };

struct DeviceInfo {
  std::string backend;   // name of the back end in the table of registry.cpp, for example "opencl"
  std::string platform;  // e.g. "Portable Computing Language"
  std::string vendor, name, driver, version;
  DeviceType type = DeviceType::cpu;
  std::uint64_t memory_bytes = 0, max_allocation_bytes = 0;
  unsigned compute_units = 1;
  // Number of vector lanes that a work-item should use explicitly. It is 1 on GPUs, and on devices whose
  // driver combines several work-items to a vector. The choice of the rasteriser depends on it
  // (raster_kind()).
  unsigned float_vector_width = 1;
  bool has_double = false;
  bool sorts_by_copying = false;  // sorting by tile needs memory for a second copy of keys and values
  bool has_cpu_raster = false;    // supports RasterKind::cpu; all devices support RasterKind::gpu
  // PCI address, for example "0000:1b:00.0", or empty if unknown. All back ends report the same address for a
  // GPU.
  std::string pci;
  // OpenCL C version that kernels with sub-group functions must be compiled for, for example "CL3.0". Empty
  // if the device does not support sub-groups.
  std::string subgroup_language;
  // Names (macros) and values of the kernel constants that do not have their default values on this device
  // (`ubs-lab tune`). Results depend on them.
  std::map<std::string, unsigned> tuning;
};
std::string_view to_string(DeviceType type);
// Returns a line "NAME (BACKEND, PLATFORM, driver VERSION)", which is printed and stored with results.
std::string describe(const DeviceInfo& info);

// Returns the index of the first device in the list that is the same GPU as the device `index`. This may be
// `index` itself.
std::size_t same_card(const std::vector<DeviceInfo>& devices, std::size_t index);

class MetricOps;
class Stages;
class TunableDevice;
struct KernelConfig;

// DeviceAddress is an address of device memory, for other code in the same process.
struct DeviceAddress {
  void* pointer = nullptr;
  MemoryKind kind = MemoryKind::host;
  int ordinal = 0;  // number of the device among those with memory of this kind
};

// Memory is an allocation on a device, without a type. Back ends derive their classes from it.
class Memory {
 public:
  virtual ~Memory() = default;
  // Returns the address of the memory. The pointer is null if the memory has no permanent address, which is
  // the case for OpenCL memory, except with PoCL on CPUs.
  virtual DeviceAddress address() const { return {}; }
  std::size_t bytes() const { return bytes_; }
  const std::string& label() const { return label_; }

 protected:
  Memory(std::string label, std::size_t bytes) : label_(std::move(label)), bytes_(bytes) {}

 private:
  std::string label_;
  std::size_t bytes_;
};

// PendingRead is a copy to the host that has been enqueued. It must not outlive its device.
class PendingRead {
 public:
  virtual ~PendingRead() = default;
  // Waits until the copy is complete, and returns the bytes. Does not wait for work that was enqueued after
  // the copy.
  virtual std::span<const std::byte> wait() = 0;
};

struct TimerEntry {
  std::string name;  // name of a kernel or of a kind of copy
  std::uint64_t calls = 0;
  double device_ms = 0;  // total time of all calls on the device [ms]
};

// ProgramUse describes a program that this process has built: its sources, the compiler options that
// specialise them, and the kernels that are used.
struct ProgramUse {
  std::string sources, options;
  std::vector<std::string> kernels;
};

class Device {
 public:
  virtual ~Device() = default;
  virtual const DeviceInfo& info() const = 0;

  // Allocates memory. Throws Error(memory) if the device cannot allocate it; the message contains the sizes.
  virtual std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) = 0;
  // Copies bytes to the device. Returns when `from` may be changed.
  virtual void write(Memory& to, std::size_t offset, std::span<const std::byte> from) = 0;
  // Copies bytes to the host, and waits for them.
  virtual void read(const Memory& from, std::size_t offset, std::span<std::byte> to) = 0;
  // Waits for all enqueued work and calls `use` with the first `bytes` bytes of the memory. If the device
  // computes in host memory, `use` gets the memory itself. Otherwise it gets a copy in `room`, which is
  // enlarged if necessary.
  virtual void show(const Memory& from, std::size_t bytes, std::vector<std::byte>& room,
                    const std::function<void(std::span<const std::byte>)>& use);
  // Enqueues a copy to the host and returns at once.
  virtual std::unique_ptr<PendingRead> read_later(const Memory& from, std::size_t offset,
                                                  std::size_t bytes) = 0;
  virtual void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
                    std::size_t bytes) = 0;
  virtual void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) = 0;
  // Enqueues a copy to the device that starts when all work that was enqueued before has finished, and then
  // runs in parallel with work that is enqueued later. Work that is enqueued after the next join_uploads()
  // uses the copied data. Returns as soon as `from` may be changed.
  virtual void copy_async(Memory& to, std::span<const std::byte> from) = 0;
  virtual void join_uploads() = 0;
  // Waits until all enqueued work has finished.
  virtual void finish() = 0;

  std::uint64_t allocated_bytes() const { return allocated_; }
  std::uint64_t peak_bytes() const { return peak_; }
  // Returns the maximum total size [bytes] of the buffers with each label since reset_peak().
  const std::map<std::string, std::uint64_t>& peak_by_label() const { return peaks_; }
  // Starts to measure the maximum again, so that callers can measure a part of the work of the process.
  void reset_peak() {
    peak_ = allocated_;
    peaks_ = by_label_;
  }
  // set_profiling() enables or disables the measurement of device times. timings() returns the device times
  // of all kernels and copies since the measurement was enabled, or nothing if it is disabled.
  virtual void set_profiling(bool on) = 0;
  virtual std::vector<TimerEntry> timings() const = 0;
  // Returns the programs that were built at run time. Returns nothing if the kernels of the back end are
  // compiled when ubs is built.
  virtual std::vector<ProgramUse> programs() const { return {}; }

  // make_stages() and make_metric_ops() return the operations of the method on this device. Use the functions
  // with the same names in host/device/operations.hpp instead, which also check the configuration.
  virtual std::unique_ptr<Stages> make_stages(const KernelConfig& config) = 0;
  virtual std::unique_ptr<MetricOps> make_metric_ops() = 0;
  // Returns the interface for `ubs-lab tune`, or null if nothing can be tuned on this device.
  virtual TunableDevice* tunable() { return nullptr; }

 protected:
  // Back ends call this function for each allocation, and with a negative number of bytes when they free
  // memory.
  void account(const std::string& label, std::int64_t bytes) {
    allocated_ += static_cast<std::uint64_t>(bytes);
    if (allocated_ > peak_) peak_ = allocated_;
    std::uint64_t& now = by_label_[label];
    now += static_cast<std::uint64_t>(bytes);
    std::uint64_t& most = peaks_[label];
    most = std::max(most, now);
  }

 private:
  std::uint64_t allocated_ = 0, peak_ = 0;
  std::map<std::string, std::uint64_t> by_label_, peaks_;
};

// BufferView is a typed view of device memory that starts with its first element. Stages get their buffers as
// views. A view does not own the memory.
template <typename T>
struct BufferView {
  Memory* memory = nullptr;
  std::size_t size = 0;
};

// Copies the first `size` values of a view to the host and returns them.
template <typename T>
std::vector<T> read_values(Device& device, const BufferView<T>& view, std::size_t size) {
  std::vector<T> values(size);
  if (size > 0) device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

// Calls `make` with the size `grown`. If this throws Error(memory), calls `make` with `size`. Returns the
// size that was used.
template <typename Make>
std::size_t make_grown(std::size_t size, std::size_t grown, const Make& make) {
  try {
    make(grown);
    return grown;
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::memory || grown == size) throw;
  }
  make(size);
  return size;
}

// Buffer is a typed array on a device. It owns its memory, and can be moved but not copied.
template <typename T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(Device& device, std::string_view label, std::size_t size)
      : device_(&device), label_(label), size_(size), memory_(device.allocate(label, size * sizeof(T))) {}

  std::size_t size() const { return size_; }
  BufferView<T> view() const { return {memory_.get(), size_}; }
  explicit operator bool() const { return memory_ != nullptr; }

  void upload(std::span<const T> values, std::size_t first = 0) {
    device_->write(*memory_, first * sizeof(T), std::as_bytes(values));
  }
  // Calls `use` with the first `size` values, as Device::show() does for bytes.
  void show(std::size_t size, std::vector<std::byte>& room, const std::function<void(const T*)>& use) const {
    device_->show(*memory_, size * sizeof(T), room,
                  [&](std::span<const std::byte> bytes) { use(reinterpret_cast<const T*>(bytes.data())); });
  }
  void download(std::span<T> values, std::size_t first = 0) const {
    device_->read(*memory_, first * sizeof(T), std::as_writable_bytes(values));
  }
  std::vector<T> download() const {
    std::vector<T> values(size_);
    download(std::span<T>(values));
    return values;
  }
  void zero() { device_->fill_zero(*memory_, 0, size_ * sizeof(T)); }

  // Enlarges the buffer to at least `size` values, if it is smaller. In this case its contents are lost. If
  // the device has enough memory, the buffer grows by at least half of its size, so that it is not
  // reallocated often.
  void reserve(std::size_t size) {
    if (size <= size_) return;
    std::size_t grown = std::max(size, size_ + size_ / 2);
    if (grown * sizeof(T) > device_->info().max_allocation_bytes) grown = size;
    memory_.reset();
    size_ = 0;
    size_ = make_grown(size, grown,
                       [&](std::size_t made) { memory_ = device_->allocate(label_, made * sizeof(T)); });
  }

 private:
  Device* device_ = nullptr;
  std::string label_;
  std::size_t size_ = 0;
  std::unique_ptr<Memory> memory_;
};

// Enlarges a buffer to at least `size` values, and creates it if it does not exist yet.
template <typename T>
void reserve(Device& device, Buffer<T>& buffer, const char* label, std::size_t size) {
  if (!buffer) buffer = Buffer<T>(device, label, 0);
  buffer.reserve(size);
}

}  // namespace ubs
