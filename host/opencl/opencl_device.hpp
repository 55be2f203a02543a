// SPDX-License-Identifier: Apache-2.0
// OpenclDevice is one OpenCL device with its context, an in-order queue, a second queue for uploads, and its
// built programs.
#pragma once

#include <array>
#include <map>
#include <set>

#include "host/device/device.hpp"
#include "host/device/kernel_options.hpp"
#include "host/device/tuning.hpp"
#include "host/opencl/kernel.hpp"
#include "host/opencl/late_read.hpp"

namespace ubs::opencl {

// ProgramSpec describes a program. `sources` are names of embedded files relative to kernels/, in the order
// of concatenation. assemble() (sources.hpp) adds the headers that all programs need before them. `options`
// are "-DNAME=VALUE" and compiler flags. They are sorted, so their order does not matter.
struct ProgramSpec {
  std::vector<std::string> sources;
  std::vector<std::string> options;
};

class OpenclDevice;

// Returns a program that is specialised for the number of dimensions of a splat (UBS_N), the variant, the
// math mode and the vector width (UBS_VW).
ProgramSpec splat_program(const OpenclDevice& device, const KernelConfig& config,
                          std::vector<std::string> sources);
// Returns the option for correctly rounded divisions and square roots, or no option if the device does not
// support it. The projection and Adam use it. By default, OpenCL allows an error of 2.5 ulp in a division and
// of 3 ulp in a square root, but the bounds in kernels/limits.h were determined with correct rounding. CPUs
// always round correctly, so they do not need the option.
Options exact_division_options(const OpenclDevice& device);

class OpenclDevice final : public Device, public TunableDevice {
 public:
  OpenclDevice(cl_platform_id platform, cl_device_id device, DeviceInfo info);
  ~OpenclDevice() override;

  const DeviceInfo& info() const override { return info_; }
  std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) override;
  void write(Memory& to, std::size_t offset, std::span<const std::byte> from) override;
  void read(const Memory& from, std::size_t offset, std::span<std::byte> to) override;
  void show(const Memory& from, std::size_t bytes, std::vector<std::byte>& room,
            const std::function<void(std::span<const std::byte>)>& use) override;
  std::unique_ptr<PendingRead> read_later(const Memory& from, std::size_t offset, std::size_t bytes) override;
  void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
            std::size_t bytes) override;
  void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) override;
  void copy_async(Memory& to, std::span<const std::byte> from) override;
  void join_uploads() override;
  void finish() override;
  // Makes the driver start the enqueued work, even if the driver would otherwise wait for more work.
  void flush() { check(clFlush(queue_.get()), "clFlush"); }
  void set_profiling(bool on) override;
  std::vector<TimerEntry> timings() const override;
  std::vector<ProgramUse> programs() const override;
  std::unique_ptr<Stages> make_stages(const KernelConfig& config) override;
  std::unique_ptr<MetricOps> make_metric_ops() override;
  TunableDevice* tunable() override { return this; }

  // Returns the program with the tuned constants of its sources added to the options.
  ProgramSpec tuned(ProgramSpec spec) const;
  TunedTable tuned_constants() const override;
  void set_tuning(TuningValues values) override { info_.tuning = std::move(values); }

  // created_kernels() returns the names of all kernels that have been launched or prepared for a launch.
  // compiled_kernels() returns the names of all kernels in the programs that were built for these.
  std::set<std::string> created_kernels() const;
  std::set<std::string> compiled_kernels() const;

  // Returns a kernel. Its program is built once per spec and device object. Some drivers, such as PoCL,
  // compile the kernel only at its first launch.
  Kernel kernel(const ProgramSpec& spec, const std::string& name);
  // Returns whether this is PoCL's own CPU driver, whose kernels are compiled by clang and run in this
  // process.
  bool on_pocl_cpu() const { return on_pocl_cpu_; }
  // Returns the number of lanes of an explicit float vector on this device: 16, 8 or 4 if the device uses the
  // kernels for CPUs, and 1 otherwise (platform.cpp).
  unsigned vector_width() const { return info_.float_vector_width; }

  cl_context context() const { return context_.get(); }
  cl_device_id id() const { return device_; }
  cl_command_queue queue() const { return queue_.get(); }
  // Takes ownership of the event of a profiled launch or copy. Ignores null events.
  void record(const std::string& name, cl_event event);
  bool profiling() const { return profiling_; }
  bool synchronous() const { return synchronous_; }  // UBS_SYNC=1: wait after each launch

 private:
  friend class OpenclMemory;
  struct Staged {  // a pending write; `block` must not change until `event` has completed
    PinnedBlock block;
    EventHandle event;
  };
  QueueHandle make_queue() const;
  void write_staged(cl_mem to, std::size_t offset, std::span<const std::byte> from);
  void write_from(Staged& staged, cl_command_queue queue, cl_mem to, std::size_t offset,
                  std::span<const std::byte> from, const std::vector<cl_event>& after);
  void collect() const;

  cl_device_id device_;
  DeviceInfo info_;
  bool on_pocl_cpu_ = false, profiling_ = false, synchronous_ = false;
  ContextHandle context_;
  QueueHandle queue_, upload_queue_;  // the second one is created by the first copy_async()
  std::map<std::string, ProgramHandle> programs_;
  std::map<std::pair<std::string, std::string>, std::set<std::string>> kernels_;  // by sources and options
  std::array<Staged, 16> staged_;
  std::size_t next_staged_ = 0;
  std::array<Staged, 2> uploads_;
  std::size_t next_upload_ = 0;
  std::vector<cl_event> pending_uploads_;  // events of uploads that join_uploads() has not yet joined
  ReadBlocks reads_;
  mutable std::vector<std::pair<std::string, EventHandle>> pending_;
  mutable std::map<std::string, TimerEntry> timings_;
};

}  // namespace ubs::opencl
