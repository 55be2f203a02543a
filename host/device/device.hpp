// SPDX-License-Identifier: Apache-2.0
// The lower of the two layers between the pipeline and a back end: where memory lives and how bytes
// move. Work is ordered: everything given to a device's queue happens in the order it was given.
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
  unsigned float_vector_width = 1;  // lanes a work-item should use explicitly; 1 on GPUs and where the
                                    // driver fills vectors with work-items; decides the rasteriser
  bool has_double = false;
  bool sorts_by_copying = false;  // sorts of tiles take memory for a second copy of keys and values
  std::string pci;  // "0000:1b:00.0"; empty: unknown. The same card in several back ends has the same
  std::string
      subgroup_language;  // language version that sub-group functions need, "CL3.0"; empty: there are none
  // Kernel constants that are not at their defaults on this device, by macro (`ubs-lab tune`): part of what
  // results depend on.
  std::map<std::string, unsigned> tuning;
};
std::string_view to_string(DeviceType type);
// One line: "name (platform, driver ...)", as printed and stored with every result.
std::string describe(const DeviceInfo& info);

// Place in the list of the first device that is the same card; its own place where there is none before it.
std::size_t same_card(const std::vector<DeviceInfo>& devices, std::size_t index);

class MetricOps;
class Stages;
class TunableDevice;
struct KernelConfig;

// Memory as other programs of the same process find it.
struct DeviceAddress {
  void* pointer = nullptr;
  bool on_card = false;  // of CUDA, else the host reads it too
  int ordinal = 0;       // of the card
};

// Untyped device memory; the back end derives from it.
class Memory {
 public:
  virtual ~Memory() = default;
  // No pointer where it has no address that lasts: OpenCL but for PoCL on CPUs.
  virtual DeviceAddress address() const { return {}; }
  std::size_t bytes() const { return bytes_; }
  const std::string& label() const { return label_; }

 protected:
  Memory(std::string label, std::size_t bytes) : label_(std::move(label)), bytes_(bytes) {}

 private:
  std::string label_;
  std::size_t bytes_;
};

// A copy to the host that is on its way. Must not outlive its device.
class PendingRead {
 public:
  virtual ~PendingRead() = default;
  // Waits for the copy and what was given before it, not for what was given after it.
  virtual std::span<const std::byte> wait() = 0;
};

struct TimerEntry {
  std::string name;  // kernel or copy
  std::uint64_t calls = 0;
  double device_ms = 0;
};

// A program that was built for this process: what is specialised by what, and the kernels taken from it.
struct ProgramUse {
  std::string sources, options;
  std::vector<std::string> kernels;
};

class Device {
 public:
  virtual ~Device() = default;
  virtual const DeviceInfo& info() const = 0;

  // Throws Error(memory) with the sizes when the request exceeds what the device can give.
  virtual std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) = 0;
  virtual void write(Memory& to, std::size_t offset,
                     std::span<const std::byte> from) = 0;  // returns when copied
  virtual void read(const Memory& from, std::size_t offset,
                    std::span<std::byte> to) = 0;  // waits for the result
  // Gives `use` the first bytes: as they lie where the device computes in memory of the host, else as a copy
  // in `room`, which keeps its memory. Waits for the result.
  virtual void show(const Memory& from, std::size_t bytes, std::vector<std::byte>& room,
                    const std::function<void(std::span<const std::byte>)>& use);
  // Takes its place in the queue and returns at once.
  virtual std::unique_ptr<PendingRead> read_later(const Memory& from, std::size_t offset,
                                                  std::size_t bytes) = 0;
  virtual void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
                    std::size_t bytes) = 0;
  virtual void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) = 0;
  // A copy that runs beside the queue: it begins when everything given so far is done, and everything given
  // after the next join_uploads() sees it. Returns when `from` may change.
  virtual void copy_async(Memory& to, std::span<const std::byte> from) = 0;
  virtual void join_uploads() = 0;
  virtual void finish() = 0;

  std::uint64_t allocated_bytes() const { return allocated_; }
  std::uint64_t peak_bytes() const { return peak_; }
  // Most bytes at a time of the buffers of each label, since reset_peak().
  const std::map<std::string, std::uint64_t>& peak_by_label() const { return peaks_; }
  void reset_peak() {  // to measure a part of a process
    peak_ = allocated_;
    peaks_ = by_label_;
  }
  // Device time per kernel since profiling was switched on (empty when it is off).
  virtual void set_profiling(bool on) = 0;
  virtual std::vector<TimerEntry> timings() const = 0;
  // Empty where kernels are compiled ahead of time.
  virtual std::vector<ProgramUse> programs() const { return {}; }

  // The operations of the method on this device. To be called through make_stages() and the like of
  // host/device/operations.hpp, which check what is asked for.
  virtual std::unique_ptr<Stages> make_stages(const KernelConfig& config) = 0;
  virtual std::unique_ptr<MetricOps> make_metric_ops() = 0;
  // Null where nothing can be tuned.
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

// A range of typed elements of a buffer; what stages take. Does not own.
template <typename T>
struct BufferView {
  Memory* memory = nullptr;
  std::size_t size = 0;
};

// The first values of a view, on the host.
template <typename T>
std::vector<T> read_values(Device& device, const BufferView<T>& view, std::size_t size) {
  std::vector<T> values(size);
  if (size > 0) device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

// Makes a thing of size `grown`, or of `size` where there is no memory for that. Returns which.
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

// Owning, move-only, typed device array.
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

  // Content is lost when it grows; grows by at least half where the device has that much, so that repeated
  // growth is amortised.
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

// Buffer::reserve() of one that may not be there yet.
template <typename T>
void reserve(Device& device, Buffer<T>& buffer, const char* label, std::size_t size) {
  if (!buffer) buffer = Buffer<T>(device, label, 0);
  buffer.reserve(size);
}

}  // namespace ubs
