// SPDX-License-Identifier: Apache-2.0
// Building programs from the embedded sources and launching their kernels with checked arguments.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/device.hpp"
#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

class OpenclDevice;

// Of flat kernels: with 16 work-items a group they lose half of the bandwidth on PoCL.
constexpr std::size_t kFlatGroup = 64;

struct Range {
  std::size_t x = 1, y = 1, z = 1;
};
struct LocalBytes {  // a __local pointer argument
  std::size_t bytes = 0;
};
// A number of elements: passed by value, or, where only the device knows it, as the buffer of one that holds
// it (kernels/opencl/amount.h).
struct Amount {
  std::uint32_t most = 0;
  View1<std::uint32_t> counted = {};
};

// A kernel of a built program. Launches are enqueued in order on the device's queue.
//   kernel(Range{global}, Range{local}, records.view(), count, LocalBytes{256});
// Buffers are passed as View1<T> (an empty view is a null pointer), scalars by value with exactly the
// kernel's type. Global sizes must be multiples of local sizes. A launch with a zero global size does
// nothing.
class Kernel {
 public:
  Kernel() = default;
  Kernel(OpenclDevice& device, cl_program program, std::string name);

  template <typename... Args>
  void operator()(Range global, Range local, const Args&... args) {
    check_count(sizeof...(Args));
    cl_uint index = 0;
    (set(index++, args), ...);
    launch(global, local);
  }
  const std::string& name() const { return name_; }
  // Most work-items of a sub-group in groups of this size; 0 where the driver does not say.
  std::size_t sub_group_size(Range group) const;

 private:
  template <typename T>
  void set(cl_uint index, const View1<T>& view) {
    cl_mem memory = memory_of(view.memory);
    set_bytes(index, sizeof memory, &memory);
  }
  void set(cl_uint index, const Amount& amount) {
    if (amount.counted.memory)
      set(index, amount.counted);
    else
      set(index, amount.most);
  }
  void set(cl_uint index, const LocalBytes& local) { set_bytes(index, local.bytes, nullptr); }
  template <typename T>
  requires std::is_arithmetic_v<T>
  void set(cl_uint index, const T& value) { set_bytes(index, sizeof value, &value); }

  static cl_mem memory_of(Memory* memory);
  void check_count(std::size_t given) const;
  void set_bytes(cl_uint index, std::size_t bytes, const void* value);
  void launch(Range global, Range local);

  OpenclDevice* device_ = nullptr;
  std::string name_;
  cl_uint argument_count_ = 0;
  KernelHandle kernel_;
};

// Rounds up to a multiple, for global sizes.
inline std::size_t round_up(std::size_t value, std::size_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace ubs::opencl
