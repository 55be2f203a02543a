// SPDX-License-Identifier: Apache-2.0
// devices_under_test() returns the devices on which device tests run: all devices of the machine, or the one
// that is selected with --device.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/device/registry.hpp"

namespace ubs::test {

// Returns the devices, which are opened once and shared by all tests of the process.
std::vector<std::shared_ptr<Device>> devices_under_test();
// Returns those of these devices that belong to the OpenCL back end.
std::vector<std::shared_ptr<Device>> opencl_devices_under_test();
// Return the rasterisers of a device and their names in settings: "cpu" and "gpu", or only "gpu" for CUDA
// devices.
std::vector<RasterKind> rasters_of(const Device& device);
std::vector<std::string> raster_names_of(const Device& device);
// Returns whether the device is the CUDA back end on the host. This device compiles the programs of variants
// while the tests run. Compiling takes a long time, so tests should use only a few variants. If UBS_TEST_ALL
// is set in the environment, this function returns false, so that all variants are tested as on other
// devices.
bool on_host(const Device& device);
// Selects the devices under test from the options of tests/main.cpp. An empty `request` selects all. Returns
// an exit code: 0, or 77 if an optional device does not exist.
int use_device(const std::string& request, bool optional, bool cuda_on_host);

}  // namespace ubs::test

namespace ubs {
using test::devices_under_test;
using test::on_host;
using test::opencl_devices_under_test;
using test::raster_names_of;
using test::rasters_of;
}  // namespace ubs
