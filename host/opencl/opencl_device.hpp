// SPDX-License-Identifier: Apache-2.0
// One OpenCL device with its context, one in-order queue and its built programs.
#pragma once

#include <array>
#include <map>
#include <set>

#include "host/device/device.hpp"
#include "host/device/stages.hpp"
#include "host/opencl/kernel.hpp"

namespace ubs::opencl {

// Sources are names of embedded files relative to kernels/ in the order of concatenation;
// dialect/dialect.h, variant.h, limits.h, layout.h, dialect/entry.h and math/elementary.h always come first, unnamed.
// Options are "-DNAME=VALUE" and compiler flags; they are sorted, so their order does not matter.
struct ProgramSpec {
  std::vector<std::string> sources;
  std::vector<std::string> options;
};

class OpenclDevice;

// The switches of kernels/variant.h that are not at their default: a default program has none of them, so
// that its name in the driver's cache does not depend on which switches exist.
std::vector<std::string> variant_options(const ModelVariant& variant);

// Likewise for what projection and rasteriser leave out: splats and pixels whose alpha does not count, backward.
std::vector<std::string> extent_options(const KernelConfig& config);
void append(std::vector<std::string>& options, const std::vector<std::string>& more);
// "-DUBS_FROZEN=..." where groups are frozen: of programs that touch gradients or moments.
std::vector<std::string> frozen_options(const KernelConfig& config);

// A program specialised for the splat's dimension (UBS_N), the variant and the device's vector width (UBS_VW).
ProgramSpec splat_program(const OpenclDevice& device, const KernelConfig& config,
                          std::vector<std::string> sources);

class OpenclDevice final : public Device {
 public:
  OpenclDevice(cl_platform_id platform, cl_device_id device, DeviceInfo info);
  ~OpenclDevice() override;

  const DeviceInfo& info() const override { return info_; }
  std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) override;
  void write(Memory& to, std::size_t offset, std::span<const std::byte> from) override;
  void read(const Memory& from, std::size_t offset, std::span<std::byte> to) override;
  void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
            std::size_t bytes) override;
  void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) override;
  void finish() override;
  void set_profiling(bool on) override;
  std::vector<TimerEntry> timings() const override;

  // With the tuned constants of its sources as options.
  ProgramSpec tuned(ProgramSpec spec) const;
  // For stages made from now on.
  void set_tuning(std::map<std::string, unsigned> values) { info_.tuning = std::move(values); }

  // Names of all kernels that have been launched or made ready for it, and of all in the programs built for them.
  std::set<std::string> created_kernels() const { return created_; }
  std::set<std::string> compiled_kernels() const;

  // Built once per spec and device object; a kernel of it is compiled by the driver on first use.
  Kernel kernel(const ProgramSpec& spec, const std::string& name);
  bool is_pocl() const { return is_pocl_; }
  // Lanes of an explicit float vector on this device: 16, 8 or 4 on CPUs, 1 on GPUs.
  unsigned vector_width() const { return info_.float_vector_width; }

  cl_context context() const { return context_.get(); }
  cl_device_id id() const { return device_; }
  cl_command_queue queue() const { return queue_.get(); }
  // Takes over an event of a profiled launch; null events are ignored.
  void record(const std::string& name, cl_event event);
  bool profiling() const { return profiling_; }
  bool synchronous() const { return synchronous_; }  // UBS_SYNC=1: wait after each launch

 private:
  friend class OpenclMemory;
  void make_queue();
  void write_staged(cl_mem to, std::size_t offset, std::span<const std::byte> from);
  void collect() const;

  cl_device_id device_;
  DeviceInfo info_;
  bool is_pocl_ = false, profiling_ = false, synchronous_ = false;
  ContextHandle context_;
  QueueHandle queue_;
  std::map<std::string, ProgramHandle> programs_;
  std::set<std::string> created_;
  struct Staged {  // a small write on its way; its bytes live until its event has passed
    std::vector<std::byte> bytes;
    EventHandle event;
  };
  std::array<Staged, 16> staged_;
  std::size_t next_staged_ = 0;
  mutable std::vector<std::pair<std::string, EventHandle>> pending_;
  mutable std::map<std::string, TimerEntry> timings_;
};

}  // namespace ubs::opencl
