// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/opencl_device.hpp"

#include <algorithm>
#include <sstream>

#include "host/base/environment.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/stop_request.hpp"
#include "host/opencl/driver_watch.hpp"
#include "host/opencl/huge_pages.hpp"
#include "host/opencl/memory.hpp"
#include "host/opencl/opencl_tuning.hpp"
#include "host/opencl/sources.hpp"

namespace ubs::opencl {
namespace {

constexpr std::size_t kStagedBytes = 4096;

cl_mem handle_of(const Memory& memory) { return static_cast<const OpenclMemory&>(memory).handle(); }

std::string build_log(cl_program program, cl_device_id device) {
  std::size_t bytes = 0;
  clGetProgramBuildInfo(program, device, CL_PROGRAM_BUILD_LOG, 0, nullptr, &bytes);
  std::string log(bytes, '\0');
  if (bytes) clGetProgramBuildInfo(program, device, CL_PROGRAM_BUILD_LOG, bytes, log.data(), nullptr);
  return log.c_str();
}

}  // namespace

OpenclMemory::OpenclMemory(OpenclDevice& device, std::string label, std::size_t bytes)
    : Memory(std::move(label), bytes), device_(device) {
  const DeviceInfo& info = device.info();
  if (bytes > info.max_allocation_bytes)
    fail(ErrorKind::memory,
         "buffer '{}' needs {} MiB, but {} can allocate at most {} MiB for one buffer; "
         "use fewer splats or smaller images",
         this->label(), bytes >> 20, info.name, info.max_allocation_bytes >> 20);
  if (info.memory_bytes == 0)
    fail(ErrorKind::memory, "the limits of this process leave no memory for buffers of {}: raise them{}",
         info.name, memory_limits_text());
  if (device.allocated_bytes() + bytes > info.memory_bytes)
    fail(ErrorKind::memory,
         "buffer '{}' needs {} MiB, but {} of the {} MiB of {} are already in use: use fewer splats or "
         "smaller "
         "images{}",
         this->label(), bytes >> 20, device.allocated_bytes() >> 20, info.memory_bytes >> 20, info.name,
         memory_limits_text());
  if (info.type == DeviceType::cpu) memory_ = make_in_huge_pages(device.context(), bytes);
  cl_int code = CL_SUCCESS;
  // OpenCL does not allow buffers of zero bytes, but arrays may be empty.
  if (!memory_)
    memory_.reset(clCreateBuffer(device.context(), CL_MEM_READ_WRITE, std::max<std::size_t>(bytes, 64),
                                 nullptr, &code));
  if (code != CL_SUCCESS)
    fail(ErrorKind::memory, "allocation of buffer '{}' of {} MiB failed with {} ({} MiB in use)",
         this->label(), bytes >> 20, error_name(code), device.allocated_bytes() >> 20);
  device_.account(this->label(), static_cast<std::int64_t>(bytes));
}

// On CPUs PoCL computes in the memory that it maps, and the address stays the same as long as the buffer
// exists.
DeviceAddress OpenclMemory::address() const {
  if (!device_.on_pocl_cpu_ || bytes() == 0) return {};
  if (address_) return {address_};
  cl_int code = CL_SUCCESS;
  address_ = clEnqueueMapBuffer(device_.queue_.get(), memory_.get(), CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0,
                                bytes(), 0, nullptr, nullptr, &code);
  check(code, "clEnqueueMapBuffer");
  check(clEnqueueUnmapMemObject(device_.queue_.get(), memory_.get(), address_, 0, nullptr, nullptr),
        "clEnqueueUnmapMemObject");
  return {address_};
}

OpenclMemory::~OpenclMemory() { device_.account(label(), -static_cast<std::int64_t>(bytes())); }

OpenclDevice::OpenclDevice(cl_platform_id platform, cl_device_id device, DeviceInfo info)
    : device_(device), info_(std::move(info)), synchronous_(environment_flag("UBS_SYNC")) {
  on_pocl_cpu_ = info_.type == DeviceType::cpu &&
                 info_.platform.find("Portable Computing Language") != std::string::npos;
  const cl_context_properties properties[] = {CL_CONTEXT_PLATFORM,
                                              reinterpret_cast<cl_context_properties>(platform), 0};
  cl_int code = CL_SUCCESS;
  context_.reset(clCreateContext(properties, 1, &device_, nullptr, nullptr, &code));
  check(code, "clCreateContext");
  queue_ = make_queue();
}

// Waits for the queues, because staged writes may still be pending.
OpenclDevice::~OpenclDevice() {
  if (queue_) clFinish(queue_.get());
  if (upload_queue_) clFinish(upload_queue_.get());
}

QueueHandle OpenclDevice::make_queue() const {
  cl_int code = CL_SUCCESS;
  QueueHandle queue(
      clCreateCommandQueue(context_.get(), device_, profiling_ ? CL_QUEUE_PROFILING_ENABLE : 0, &code));
  check(code, "clCreateCommandQueue");
  return queue;
}

std::unique_ptr<Memory> OpenclDevice::allocate(std::string_view label, std::size_t bytes) {
  return std::make_unique<OpenclMemory>(*this, std::string(label), bytes);
}

void OpenclDevice::write(Memory& to, std::size_t offset, std::span<const std::byte> from) {
  if (from.empty()) return;
  if (from.size() <= kStagedBytes) return write_staged(handle_of(to), offset, from);
  cl_event event = nullptr;
  check(clEnqueueWriteBuffer(queue_.get(), handle_of(to), CL_TRUE, offset, from.size(), from.data(), 0,
                             nullptr, profiling_ ? &event : nullptr),
        "clEnqueueWriteBuffer");
  record("write", event);
}

// Small writes, such as the learning rates of every iteration, are copied to a staging buffer first. A
// blocking write would wait for all work before it in the queue.
void OpenclDevice::write_staged(cl_mem to, std::size_t offset, std::span<const std::byte> from) {
  Staged& staged = staged_[next_staged_];
  next_staged_ = (next_staged_ + 1) % staged_.size();
  write_from(staged, queue_.get(), to, offset, from, {});
}

void OpenclDevice::write_from(Staged& staged, cl_command_queue queue, cl_mem to, std::size_t offset,
                              std::span<const std::byte> from, const std::vector<cl_event>& after) {
  if (cl_event last = staged.event.get()) check(clWaitForEvents(1, &last), "clWaitForEvents");
  if (staged.block.size() < from.size()) {
    staged.block = {};
    staged.block =
        PinnedBlock(context(), queue, std::max(from.size(), kStagedBytes), PinnedBlock::Use::write);
  }
  std::ranges::copy(from, staged.block.bytes());
  cl_event event = nullptr;
  check(clEnqueueWriteBuffer(queue, to, CL_FALSE, offset, from.size(), staged.block.bytes(),
                             static_cast<cl_uint>(after.size()), after.empty() ? nullptr : after.data(),
                             &event),
        "clEnqueueWriteBuffer");
  staged.event.reset(event);
  if (!profiling_) return;
  check(clRetainEvent(event), "clRetainEvent");
  record("write", event);
}

void OpenclDevice::copy_async(Memory& to, std::span<const std::byte> from) {
  if (from.empty()) return;
  if (!upload_queue_) upload_queue_ = make_queue();
  if (pending_uploads_.size() == uploads_.size()) join_uploads();
  cl_event given = nullptr;
  check(clEnqueueMarkerWithWaitList(queue_.get(), 0, nullptr, &given), "clEnqueueMarkerWithWaitList");
  const EventHandle before(given);
  check(clFlush(queue_.get()), "clFlush");
  Staged& staged = uploads_[next_upload_];
  next_upload_ = (next_upload_ + 1) % uploads_.size();
  write_from(staged, upload_queue_.get(), handle_of(to), 0, from, {given});
  check(clFlush(upload_queue_.get()), "clFlush");
  pending_uploads_.push_back(staged.event.get());
}

void OpenclDevice::join_uploads() {
  if (pending_uploads_.empty()) return;
  check(clEnqueueBarrierWithWaitList(queue_.get(), static_cast<cl_uint>(pending_uploads_.size()),
                                     pending_uploads_.data(), nullptr),
        "clEnqueueBarrierWithWaitList");
  pending_uploads_.clear();
}

void OpenclDevice::read(const Memory& from, std::size_t offset, std::span<std::byte> to) {
  if (to.empty()) return;
  cl_event event = nullptr;
  check(clEnqueueReadBuffer(queue_.get(), handle_of(from), CL_TRUE, offset, to.size(), to.data(), 0, nullptr,
                            profiling_ ? &event : nullptr),
        "clEnqueueReadBuffer");
  record("read", event);
}

// Maps the memory only on CPUs, because a GPU would copy the memory to map it.
void OpenclDevice::show(const Memory& from, std::size_t bytes, std::vector<std::byte>& room,
                        const std::function<void(std::span<const std::byte>)>& use) {
  if (info_.type != DeviceType::cpu || bytes == 0) return Device::show(from, bytes, room, use);
  cl_event event = nullptr;
  cl_int code = CL_SUCCESS;
  void* mapped = clEnqueueMapBuffer(queue_.get(), handle_of(from), CL_TRUE, CL_MAP_READ, 0, bytes, 0, nullptr,
                                    profiling_ ? &event : nullptr, &code);
  check(code, "clEnqueueMapBuffer");
  record("read", event);
  const std::shared_ptr<void> unmap(mapped, [&](void* pointer) {
    clEnqueueUnmapMemObject(queue_.get(), handle_of(from), pointer, 0, nullptr, nullptr);
  });
  use({static_cast<std::byte*>(mapped), bytes});
}

std::unique_ptr<PendingRead> OpenclDevice::read_later(const Memory& from, std::size_t offset,
                                                      std::size_t bytes) {
  auto read = std::make_unique<LateRead>(reads_, context(), queue(), handle_of(from), offset, bytes);
  if (profiling_) {
    check(clRetainEvent(read->event()), "clRetainEvent");
    record("read", read->event());
  }
  return read;
}

void OpenclDevice::copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
                        std::size_t bytes) {
  if (bytes == 0) return;
  cl_event event = nullptr;
  check(clEnqueueCopyBuffer(queue_.get(), handle_of(from), handle_of(to), from_offset, to_offset, bytes, 0,
                            nullptr, profiling_ ? &event : nullptr),
        "clEnqueueCopyBuffer");
  record("copy", event);
}

void OpenclDevice::fill_zero(Memory& to, std::size_t offset, std::size_t bytes) {
  if (bytes == 0) return;
  const unsigned char zero = 0;
  cl_event event = nullptr;
  check(clEnqueueFillBuffer(queue_.get(), handle_of(to), &zero, 1, offset, bytes, 0, nullptr,
                            profiling_ ? &event : nullptr),
        "clEnqueueFillBuffer");
  record("fill", event);
}

void OpenclDevice::finish() { check(clFinish(queue_.get()), "clFinish"); }

void OpenclDevice::set_profiling(bool on) {
  finish();
  pending_.clear();
  timings_.clear();
  if (on == profiling_) return;
  join_uploads();
  finish();
  upload_queue_.reset();
  profiling_ = on;
  queue_ = make_queue();
}

void OpenclDevice::record(const std::string& name, cl_event event) {
  if (event) pending_.emplace_back(name, EventHandle(event));
  if (pending_.size() > 4096) collect();
}

void OpenclDevice::collect() const {
  check(clFinish(queue_.get()), "clFinish");
  if (upload_queue_) check(clFinish(upload_queue_.get()), "clFinish");
  for (auto& [name, event] : pending_) {
    cl_ulong start = 0, end = 0;
    check(clGetEventProfilingInfo(event.get(), CL_PROFILING_COMMAND_START, sizeof start, &start, nullptr),
          "clGetEventProfilingInfo");
    check(clGetEventProfilingInfo(event.get(), CL_PROFILING_COMMAND_END, sizeof end, &end, nullptr),
          "clGetEventProfilingInfo");
    TimerEntry& entry = timings_[name];
    entry.name = name;
    entry.calls += 1;
    entry.device_ms += static_cast<double>(end - start) * 1e-6;
  }
  pending_.clear();
}

std::vector<TimerEntry> OpenclDevice::timings() const {
  collect();
  std::vector<TimerEntry> entries;
  for (const auto& [name, entry] : timings_) entries.push_back(entry);
  return entries;
}

TunedTable OpenclDevice::tuned_constants() const { return opencl::tuned_constants(); }

ProgramSpec OpenclDevice::tuned(ProgramSpec spec) const {
  add_tuning(info_.tuning, spec.sources, spec.options);
  return spec;
}

Kernel OpenclDevice::kernel(const ProgramSpec& spec, const std::string& name) {
  std::vector<std::string> options = spec.options;
  const auto is_language = [](const std::string& option) { return option.starts_with("-cl-std="); };
  if (std::ranges::none_of(options, is_language)) options.push_back("-cl-std=CL1.2");
  if (synchronous_) options.push_back("-cl-kernel-arg-info");  // for Kernel::check_types()
  // With UBS_POCL, the kernels use built-in functions of clang, the compiler of PoCL. In Intel's CPU driver,
  // native_exp2() and native_log2() have errors of 1e-6 and are not single instructions, so they are replaced
  // by the exact functions.
  if (on_pocl_cpu_)
    options.push_back("-DUBS_POCL=1");
  else if (info_.type == DeviceType::cpu)
    append(options, {"-Dnative_exp2=exp2", "-Dnative_log2=log2"});
  // Moments and gradients of splats that are never visible decay into denormals, which make a step up to four
  // times slower on Intel's CPUs. On GPUs the option would allow compilers to round twice instead of using a
  // fused multiply-add.
  if (info_.type == DeviceType::cpu) options.push_back("-cl-denorms-are-zero");
  std::sort(options.begin(), options.end());
  const std::string files = fmt::format("{}", fmt::join(spec.sources, " + "));
  const std::string flags = fmt::format("{}", fmt::join(options, " "));
  const std::string key = files + " | " + flags;

  ProgramHandle& program = programs_[key];
  if (!program) {
    check_stop();
    const std::string source = assemble(spec.sources);
    const char* text = source.c_str();
    cl_int code = CL_SUCCESS;
    ProgramHandle built(clCreateProgramWithSource(context_.get(), 1, &text, nullptr, &code));
    check(code, "clCreateProgramWithSource");
    code = watched(files,
                   [&] { return clBuildProgram(built.get(), 1, &device_, flags.c_str(), nullptr, nullptr); });
    if (code != CL_SUCCESS)
      fail(process_memory().scarce() ? ErrorKind::memory : ErrorKind::build,
           "kernels {} cannot be built on {} ({}) with options '{}':\n{}", files, info_.name,
           error_name(code), flags, build_log(built.get(), device_));
    program = std::move(built);
  }
  kernels_[{files, flags}].insert(name);
  return Kernel(*this, program.get(), name);
}

std::set<std::string> OpenclDevice::created_kernels() const {
  std::set<std::string> names;
  for (const auto& [program, kernels] : kernels_) names.insert(kernels.begin(), kernels.end());
  return names;
}

std::set<std::string> OpenclDevice::compiled_kernels() const {
  std::set<std::string> names;
  for (const auto& [key, program] : programs_) {
    std::size_t bytes = 0;
    check(clGetProgramInfo(program.get(), CL_PROGRAM_KERNEL_NAMES, 0, nullptr, &bytes), "clGetProgramInfo");
    std::string text(bytes, '\0');
    check(clGetProgramInfo(program.get(), CL_PROGRAM_KERNEL_NAMES, bytes, text.data(), nullptr),
          "clGetProgramInfo");
    std::istringstream list(text.c_str());
    for (std::string name; std::getline(list, name, ';');) names.insert(name);
  }
  return names;
}

std::vector<ProgramUse> OpenclDevice::programs() const {
  std::vector<ProgramUse> uses;
  for (const auto& [program, kernels] : kernels_)
    uses.push_back({program.first, program.second, {kernels.begin(), kernels.end()}});
  return uses;
}

ProgramSpec splat_program(const OpenclDevice& device, const KernelConfig& config,
                          std::vector<std::string> sources) {
  ProgramSpec spec{std::move(sources), variant_options(config)};
  spec.options.push_back(fmt::format("-DUBS_N={}", config.dim));
  spec.options.push_back(fmt::format("-DUBS_VW={}", device.vector_width()));
  append(spec.options, arithmetic_options(config.math));
  return spec;
}

Options exact_division_options(const OpenclDevice& device) {
  if (device.info().type == DeviceType::cpu) return {};
  cl_device_fp_config config = 0;
  const bool known =
      clGetDeviceInfo(device.id(), CL_DEVICE_SINGLE_FP_CONFIG, sizeof config, &config, nullptr) == CL_SUCCESS;
  if (!known || !(config & CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT)) return {};
  return {"-cl-fp32-correctly-rounded-divide-sqrt"};
}

}  // namespace ubs::opencl
