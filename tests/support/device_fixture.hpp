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
// Those of them with kernels of OpenCL: tuned constants, sub-groups.
std::vector<std::shared_ptr<Device>> opencl_devices_under_test();
// Rasterisers of a device: of CUDA devices there is one.
std::vector<RasterKind> rasters_of(const Device& device);
std::vector<std::string> raster_names_of(const Device& device);
// The CUDA back end on the host: programs of variants are compiled while the tests run, so that a few must
// do. With UBS_TEST_ALL in the environment it is like any device, and all are tested.
bool on_host(const Device& device);
// The devices under test from the options of tests/main.cpp; request "": all. An exit code: 0, or 77 where an
// optional one is not there.
int use_device(const std::string& request, bool optional, bool cuda_on_host);

}  // namespace ubs::test

namespace ubs {
using test::devices_under_test;
using test::on_host;
using test::opencl_devices_under_test;
using test::raster_names_of;
using test::rasters_of;
}  // namespace ubs
