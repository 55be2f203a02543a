// SPDX-License-Identifier: Apache-2.0
// The devices that device tests run on: all of the machine, or the one named with --device.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/device/registry.hpp"

namespace ubs::test {

// Opened once and shared by all tests of the process.
std::vector<std::shared_ptr<Device>> devices_under_test();
// Those of them whose kernels are compiled at run time: variants of the method, tuned constants.
std::vector<std::shared_ptr<Device>> opencl_devices_under_test();
void select_device(const std::string& request);  // from --device; "" = all

}  // namespace ubs::test

namespace ubs {
using test::devices_under_test;
using test::opencl_devices_under_test;
}  // namespace ubs
