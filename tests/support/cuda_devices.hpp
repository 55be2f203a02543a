// SPDX-License-Identifier: Apache-2.0
// cuda_devices() returns the CUDA devices under test. An object of the class Tuned sets the tuned constants
// of a device, and resets them to their defaults when it is destroyed.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "host/device/tuning.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs::test {

inline std::vector<std::shared_ptr<Device>> cuda_devices() {
  std::vector<std::shared_ptr<Device>> devices = devices_under_test();
  std::erase_if(devices, [](const auto& device) { return device->info().backend != "cuda"; });
  return devices;
}

class Tuned {
 public:
  Tuned(Device& device, TuningValues values) : device_(dynamic_cast<TunableDevice&>(device)) {
    device_.set_tuning(std::move(values));
  }
  ~Tuned() { device_.set_tuning({}); }
  Tuned(const Tuned&) = delete;

 private:
  TunableDevice& device_;
};

}  // namespace ubs::test
