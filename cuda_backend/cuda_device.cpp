// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_device.hpp"

#include <algorithm>

#include "host/base/environment.hpp"

namespace ubs::cuda {
namespace {

constexpr std::size_t kMaxPending = 4096;  // maximum number of timed intervals whose events are kept

char* pointer_in(const Memory& memory, std::size_t offset) {
  return static_cast<char*>(static_cast<const CudaMemory&>(memory).pointer()) + offset;
}

}  // namespace

CudaMemory::CudaMemory(CudaDevice& device, std::string label, std::size_t bytes)
    : Memory(std::move(label), bytes), device_(device) {
  device_.make_current();
  const cudaError_t code = cudaMalloc(&pointer_, std::max<std::size_t>(bytes, 256));
  if (code != cudaSuccess) {
    cudaGetLastError();
    fail(code == cudaErrorMemoryAllocation ? ErrorKind::memory : ErrorKind::device,
         "buffer '{}' of {} MiB on {}: {} ({} of {} MiB in use); use fewer splats or smaller images",
         this->label(), bytes >> 20, device_.info().name, cudaGetErrorString(code),
         device_.allocated_bytes() >> 20, device_.info().memory_bytes >> 20);
  }
  device_.account(this->label(), static_cast<std::int64_t>(bytes));
}

// Waits for pending work before freeing the memory that this work may use. The documentation of CUDA does not
// say whether cudaFree waits for it.
CudaMemory::~CudaMemory() {
  cudaStreamSynchronize(device_.stream_.get());
  cudaStreamSynchronize(device_.upload_stream_.get());
  cudaFree(pointer_);
  device_.account(label(), -static_cast<std::int64_t>(bytes()));
}

DeviceAddress CudaMemory::address() const {
  cudaPointerAttributes attributes{};
  check(cudaPointerGetAttributes(&attributes, pointer_), "cudaPointerGetAttributes");
  const bool on_card = attributes.type == cudaMemoryTypeDevice;
  return {pointer_, on_card ? MemoryKind::cuda : MemoryKind::host, attributes.device};
}

CudaDevice::CudaDevice(int ordinal, DeviceInfo info)
    : ordinal_(ordinal), info_(std::move(info)), synchronous_(environment_flag("UBS_SYNC")) {
  make_current();
  cudaDeviceProp properties{};
  check(cudaGetDeviceProperties(&properties, ordinal), "cudaGetDeviceProperties");
  capability_ = 10 * properties.major + properties.minor;
  std::size_t free = 0, total = 0;
  check(cudaMemGetInfo(&free, &total), "cudaMemGetInfo");
  info_.memory_bytes = std::min<std::uint64_t>(info_.memory_bytes, free);
  info_.max_allocation_bytes = std::min(info_.max_allocation_bytes, info_.memory_bytes);
  for (StreamHandle* handle : {&stream_, &upload_stream_}) {
    cudaStream_t stream = nullptr;
    check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), "cudaStreamCreateWithFlags");
    handle->reset(stream);
  }
  given_ = make_event(false);
  staging_ = std::make_unique<Staging>();
}

CudaDevice::~CudaDevice() {
  cudaSetDevice(ordinal_);
  cudaStreamSynchronize(stream_.get());
  cudaStreamSynchronize(upload_stream_.get());
}

std::unique_ptr<Memory> CudaDevice::allocate(std::string_view label, std::size_t bytes) {
  return std::make_unique<CudaMemory>(*this, std::string(label), bytes);
}

void CudaDevice::write(Memory& to, std::size_t offset, std::span<const std::byte> from) {
  if (from.empty()) return;
  timed("write", [&] {
    staging_->upload(pointer_in(to, offset), from, stream());
    return cudaSuccess;
  });
}

void CudaDevice::read(const Memory& from, std::size_t offset, std::span<std::byte> to) {
  if (to.empty()) return;
  timed("read", [&] {
    staging_->download(to, pointer_in(from, offset), stream());
    return cudaSuccess;
  });
}

std::unique_ptr<PendingRead> CudaDevice::read_later(const Memory& from, std::size_t offset,
                                                    std::size_t bytes) {
  std::unique_ptr<CudaRead> read;
  timed("read", [&] {
    read = std::make_unique<CudaRead>(reads_, pointer_in(from, offset), bytes, stream());
    return cudaEventRecord(read->arrived(), stream());
  });
  return read;
}

void CudaDevice::copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
                      std::size_t bytes) {
  if (bytes == 0) return;
  timed("copy", [&] {
    return cudaMemcpyAsync(pointer_in(to, to_offset), pointer_in(from, from_offset), bytes,
                           cudaMemcpyDeviceToDevice, stream());
  });
}

void CudaDevice::fill_zero(Memory& to, std::size_t offset, std::size_t bytes) {
  if (bytes == 0) return;
  timed("fill", [&] { return cudaMemsetAsync(pointer_in(to, offset), 0, bytes, stream()); });
}

void CudaDevice::copy_async(Memory& to, std::span<const std::byte> from) {
  if (from.empty()) return;
  make_current();
  check(cudaEventRecord(given_.get(), stream()), "cudaEventRecord");
  check(cudaStreamWaitEvent(upload_stream_.get(), given_.get(), 0), "cudaStreamWaitEvent");
  uploads_.upload(pointer_in(to, 0), from, upload_stream_.get());
}

void CudaDevice::join_uploads() {
  make_current();
  uploads_.join(stream());
}

void CudaDevice::finish() {
  make_current();
  check(cudaStreamSynchronize(stream()), "cudaStreamSynchronize");
}

// Returns scratch memory of at least `bytes` bytes. If the memory must grow, it grows by at least half, so
// that repeated growth is amortised; if this is too much for the device, it grows to `bytes`. The stream
// orders all uses of the memory, and freeing the old memory waits for them.
void* CudaDevice::scratch(std::size_t bytes) {
  if (!scratch_ || scratch_->bytes() < bytes) {
    const std::size_t grown = scratch_ ? std::max(bytes, scratch_->bytes() + scratch_->bytes() / 2) : bytes;
    scratch_.reset();
    make_grown(bytes, grown, [&](std::size_t made) {
      scratch_ = allocate("sort and scan scratch", std::max<std::size_t>(made, 1));
    });
  }
  return pointer_in(*scratch_, 0);
}

// ---- Programs ----

const Module& CudaDevice::module(const ProgramSpec& spec) {
  Options options = spec.options;
  std::ranges::sort(options);
  const std::string flags = fmt::format("{}", fmt::join(options, " "));
  LoadedProgram& loaded = modules_[spec.file + " | " + flags];
  if (!loaded.module) {
    const std::string binary = cached_binary(spec, capability_);
    finish();  // a runtime call makes the context current, which the driver API requires
    loaded = {{spec.file, flags, spec.kernels}, std::make_unique<Module>(binary)};
  }
  return *loaded.module;
}

std::vector<ProgramUse> CudaDevice::programs() const {
  std::vector<ProgramUse> uses;
  for (const auto& [key, loaded] : modules_)
    if (loaded.module) uses.push_back(loaded.use);
  return uses;
}

// ---- Times ----

cudaEvent_t CudaDevice::start_timer() {
  if (!profiling_) return nullptr;
  open_timer_ = make_event(true);
  check(cudaEventRecord(open_timer_.get(), stream()), "cudaEventRecord");
  return open_timer_.get();
}

void CudaDevice::finish_call(const char* name, cudaError_t code, cudaEvent_t begin) {
  if (code == cudaSuccess) code = cudaGetLastError();
  if (code == cudaSuccess && begin) {
    Interval interval{name, std::move(open_timer_), make_event(true)};
    check(cudaEventRecord(interval.end.get(), stream()), "cudaEventRecord");
    pending_.push_back(std::move(interval));
    if (pending_.size() > kMaxPending) collect();
  }
  if (code == cudaSuccess && synchronous_) code = cudaStreamSynchronize(stream());
  if (code == cudaSuccess) return;
  cudaGetLastError();
  fail(code == cudaErrorMemoryAllocation ? ErrorKind::memory : ErrorKind::device,
       "'{}' on {} failed with {}: {}{}", name, info_.name, cudaGetErrorName(code), cudaGetErrorString(code),
       synchronous_ ? "" : " (an earlier call may have caused this error: set UBS_SYNC=1 to find it)");
}

void CudaDevice::set_profiling(bool on) {
  finish();
  pending_.clear();
  timings_.clear();
  profiling_ = on;
}

void CudaDevice::collect() const {
  make_current();
  check(cudaStreamSynchronize(stream()), "cudaStreamSynchronize");
  for (const Interval& interval : pending_) {
    float ms = 0;
    check(cudaEventElapsedTime(&ms, interval.begin.get(), interval.end.get()), "cudaEventElapsedTime");
    TimerEntry& entry = timings_[interval.name];
    entry.name = interval.name;
    entry.calls += 1;
    entry.device_ms += static_cast<double>(ms);
  }
  pending_.clear();
}

std::vector<TimerEntry> CudaDevice::timings() const {
  collect();
  std::vector<TimerEntry> entries;
  for (const auto& [name, entry] : timings_) entries.push_back(entry);
  return entries;
}

}  // namespace ubs::cuda
