// SPDX-License-Identifier: Apache-2.0
// Tests that an object of the C interface whose creation fails frees its device memory while it holds the
// lock of the device, because other threads may be using the device.
#include <catch2/catch.hpp>
#include <future>

#include "host/capi/handles.hpp"
#include "host/opencl/opencl_device.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

// Passes all operations on to `stages`. When it is destroyed, it stores whether this thread has the lock.
class WatchedStages final : public Stages {
 public:
  WatchedStages(std::unique_ptr<Stages> stages, std::recursive_mutex& mutex, std::vector<bool>& locked)
      : stages_(std::move(stages)), mutex_(mutex), locked_(locked) {}
  ~WatchedStages() override {
    const auto try_lock = [&] {
      const bool free = mutex_.try_lock();
      if (free) mutex_.unlock();
      return free;
    };
    locked_.push_back(!std::async(std::launch::async, try_lock).get());
  }
  const KernelConfig& config() const override { return stages_->config(); }
  Outcome run(const Operation& operation) override { return stages_->run(operation); }

 private:
  std::unique_ptr<Stages> stages_;
  std::recursive_mutex& mutex_;
  std::vector<bool>& locked_;
};

// Passes all calls on to another device, and makes WatchedStages.
class WatchedDevice final : public Device {
 public:
  WatchedDevice(Device& device, std::recursive_mutex& mutex, std::vector<bool>& locked)
      : device_(device), mutex_(mutex), locked_(locked) {}
  const DeviceInfo& info() const override { return device_.info(); }
  std::unique_ptr<Memory> allocate(std::string_view label, std::size_t bytes) override {
    return device_.allocate(label, bytes);
  }
  void write(Memory& to, std::size_t offset, std::span<const std::byte> from) override {
    device_.write(to, offset, from);
  }
  void read(const Memory& from, std::size_t offset, std::span<std::byte> to) override {
    device_.read(from, offset, to);
  }
  std::unique_ptr<PendingRead> read_later(const Memory& from, std::size_t at, std::size_t bytes) override {
    return device_.read_later(from, at, bytes);
  }
  void copy(const Memory& from, std::size_t from_offset, Memory& to, std::size_t to_offset,
            std::size_t bytes) override {
    device_.copy(from, from_offset, to, to_offset, bytes);
  }
  void fill_zero(Memory& to, std::size_t offset, std::size_t bytes) override {
    device_.fill_zero(to, offset, bytes);
  }
  void copy_async(Memory& to, std::span<const std::byte> from) override { device_.copy_async(to, from); }
  void join_uploads() override { device_.join_uploads(); }
  void finish() override { device_.finish(); }
  void set_profiling(bool on) override { device_.set_profiling(on); }
  std::vector<TimerEntry> timings() const override { return device_.timings(); }
  std::unique_ptr<Stages> make_stages(const KernelConfig& config) override {
    return std::make_unique<WatchedStages>(device_.make_stages(config), mutex_, locked_);
  }
  std::unique_ptr<MetricOps> make_metric_ops() override { return device_.make_metric_ops(); }

 private:
  Device& device_;
  std::recursive_mutex& mutex_;
  std::vector<bool>& locked_;
};

}  // namespace

TEST_CASE("a renderer whose creation fails is destroyed while its device is locked") {
  for (const auto& device : opencl_devices_under_test()) {
    const cl_device_id id = dynamic_cast<opencl::OpenclDevice&>(*device).id();
    cl_platform_id platform = nullptr;
    REQUIRE(clGetDeviceInfo(id, CL_DEVICE_PLATFORM, sizeof platform, &platform, nullptr) == CL_SUCCESS);
    DeviceInfo info = device->info();
    info.platform = "a platform without addresses";
    opencl::OpenclDevice nameless(platform, id, info);
    const auto open = std::make_shared<facade::OpenDevice>();
    std::vector<bool> locked;
    open->device = std::make_shared<WatchedDevice>(nameless, open->mutex, locked);
    ubs_device handle{open};
    ubs_model model;
    ModelVariant variant;
    variant.kernel = SpatialKernel::gaussian;
    variant.rot_mode = RotMode::quaternion;
    model.loaded.model = SplatModel(3, 4, variant);
    ubs_renderer* renderer = nullptr;
    CHECK(ubs_renderer_create(&handle, &model, nullptr, UBS_RENDER_GAUSSIANS, &renderer) == UBS_ERROR_USAGE);
    CHECK(std::string(ubs_error_message()).find("does not provide addresses") != std::string::npos);
    CHECK(renderer == nullptr);
    CHECK(locked == std::vector{true});
  }
}

}  // namespace ubs
