// SPDX-License-Identifier: Apache-2.0
// Device is the lower of the two layers between the pipeline and a back end: it manages memory and copies.
// Work is ordered: everything that is enqueued on a device runs in the order in which it was enqueued.
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

namespace ubs {

enum class DeviceType { cpu, gpu, accelerator };

struct DeviceInfo {
  std::string backend;   // "opencl", "cuda"
  std::string platform;  // e.g. "Portable Computing Language"
  std::string vendor, name, driver, version;
  DeviceType type = DeviceType::cpu;
  std::uint64_t memory_bytes = 0, max_allocation_bytes = 0;
  unsigned compute_units = 1;
  // Number of lanes that a work-item should use explicitly. It is 1 on GPUs, and on devices whose driver
  // fills vectors with work-items. It determines the rasteriser.
  unsigned float_vector_width = 1;
  bool has_double = false;
  bool sorts_by_copying = false;  // sorting by tile needs memory for a second copy of keys and values
  // "0000:1b:00.0", or empty if unknown. It is the same for a GPU in different back ends.
  std::string pci;
  // Language version that sub-group functions require, for example "CL3.0"; empty if there are none.
  std::string subgroup_language;
  // Kernel constants that do not have their default values on this device, by macro (`ubs-lab tune`). Results
  // depend on them.
  std::map<std::string, unsigned> tuning;
};
std::string_view to_string(DeviceType type);
// Returns one line, "name (platform, driver ...)", which is printed and stored with every result.
std::string describe(const DeviceInfo& info);

// Returns the index of the first device in the list that is the same GPU, which may be `index` itself.
std::size_t same_card(const std::vector<DeviceInfo>& devices, std::size_t index);

class MetricOps;
class Stages;
class TunableDevice;
struct KernelConfig;

// The address of device memory, for use by other code in the same process.
struct DeviceAddress {
  void* pointer = nullptr;
  bool on_card = false;  // memory of a CUDA device; otherwise the host can read it
  int ordinal = 0;       // index of the CUDA device
};

// Untyped device memory. Back ends derive from it.
class Memory {
 public:
  virtual ~Memory() = default;
  // Returns no pointer if the memory has no permanent address. OpenCL memory only has one with PoCL on CPUs.
  virtual DeviceAddress address() const { return {}; }
  std::size_t bytes() const { return bytes_; }
  const std::string& label() const { return label_; }

 protected:
  Memory(std::string label, std::size_t bytes) : label_(std::move(label)), bytes_(bytes) {}

 private:
  std::string label_;
  std::size_t bytes_;
};

// A pending copy to the host. Must not outlive its device.
class PendingRead {
 public:
  virtual ~PendingRead() = default;
  // Waits for the copy and for work that was enqueued before it, but not for work that was enqueued after it.
  virtual std::span<const std::byte> wait() = 0;
};

struct TimerEntry {
  std::string name;  // kernel or copy
  std::uint64_t calls = 0;
  double device_ms = 0;
};

// A program that was built in this process: the sources, the options that specialise them, and the kernels
// that are used.
struct ProgramUse {
  std::string sources, options;
  std::vector<std::string> kernels;
};

class Device {
 public:
  virtual ~Device() = default;
  virtual const DeviceInfo& info() const = 0;

  // Throws Error(memory) with the sizes if the device cannot allocate the request.
  virtual std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) = 0;
  virtual void write(Memory& to, std::size_t offset,
                     std::span<const std::byte> from) = 0;  // returns when `from` has been copied
  virtual void read(const Memory& from, std::size_t offset,
                    std::span<std::byte> to) = 0;  // waits for the result
  // Calls `use` with the first bytes of the memory. If the device computes in host memory, `use` gets the
  // memory itself; otherwise it gets a copy in `room`, which is enlarged if necessary. Waits for the result.
  virtual void show(const Memory& from, std::size_t bytes, std::vector<std::byte>& room,
                    const std::function<void(std::span<const std::byte>)>& use);
  // Enqueues a copy to the host and returns at once.
  virtual std::unique_ptr<PendingRead> read_later(const Memory& from, std::size_t offset,
                                                  std::size_t bytes) = 0;
  virtual void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
                    std::size_t bytes) = 0;
  virtual void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) = 0;
  // Starts a copy that runs in parallel with the queue. It starts when everything enqueued so far has
  // finished. Work enqueued after the next join_uploads() sees its result. Returns as soon as `from` may be
  // changed.
  virtual void copy_async(Memory& to, std::span<const std::byte> from) = 0;
  virtual void join_uploads() = 0;
  virtual void finish() = 0;

  std::uint64_t allocated_bytes() const { return allocated_; }
  std::uint64_t peak_bytes() const { return peak_; }
  // Returns, for each label, the maximum total size of its buffers since reset_peak().
  const std::map<std::string, std::uint64_t>& peak_by_label() const { return peaks_; }
  void reset_peak() {  // to measure a part of the process
    peak_ = allocated_;
    peaks_ = by_label_;
  }
  // set_profiling() enables or disables the measurement of device times. timings() returns the device time
  // per kernel since it was enabled, or nothing if it is disabled.
  virtual void set_profiling(bool on) = 0;
  virtual std::vector<TimerEntry> timings() const = 0;
  // Returns the programs built at run time; empty if kernels are compiled ahead of time.
  virtual std::vector<ProgramUse> programs() const { return {}; }

  // Return the operations of the method on this device. Call them through make_stages() and make_metric_ops()
  // of host/device/operations.hpp, which check the configuration.
  virtual std::unique_ptr<Stages> make_stages(const KernelConfig& config) = 0;
  virtual std::unique_ptr<MetricOps> make_metric_ops() = 0;
  // Returns null if nothing can be tuned.
  virtual TunableDevice* tunable() { return nullptr; }

 protected:
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

// A typed view of a buffer from its start. Stages take their buffers as such views. A view does not own the
// memory.
template <typename T>
struct BufferView {
  Memory* memory = nullptr;
  std::size_t size = 0;
};

// Returns the first values of a view on the host.
template <typename T>
std::vector<T> read_values(Device& device, const BufferView<T>& view, std::size_t size) {
  std::vector<T> values(size);
  if (size > 0) device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

// Calls `make` with the size `grown`, or with `size` if there is not enough memory. Returns the size used.
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

// A typed array on a device that owns its memory. Can be moved but not copied.
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
  // See Device::show().
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

  // The content is lost if the buffer grows. It grows by at least half if the device has enough memory, so
  // that repeated growth is amortised.
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

// Calls Buffer::reserve() of a buffer that may not have been created yet.
template <typename T>
void reserve(Device& device, Buffer<T>& buffer, const char* label, std::size_t size) {
  if (!buffer) buffer = Buffer<T>(device, label, 0);
  buffer.reserve(size);
}

}  // namespace ubs
