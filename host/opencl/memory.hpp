// SPDX-License-Identifier: Apache-2.0
// OpenclMemory is a buffer on an OpenCL device. The device's memory statistics include it as long as it
// exists.
#pragma once

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

class OpenclMemory final : public Memory {
 public:
  OpenclMemory(OpenclDevice& device, std::string label, std::size_t bytes);
  ~OpenclMemory() override;
  OpenclMemory(const OpenclMemory&) = delete;
  OpenclMemory& operator=(const OpenclMemory&) = delete;
  DeviceAddress address() const override;
  cl_mem handle() const { return memory_.get(); }

 private:
  OpenclDevice& device_;
  MemHandle memory_;
  mutable void* address_ = nullptr;  // null until address() is called
};

}  // namespace ubs::opencl
