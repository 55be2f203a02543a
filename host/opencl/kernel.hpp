// SPDX-License-Identifier: Apache-2.0
// Kernel launches a kernel of a built program and checks its arguments.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

#include "host/device/map_kernels.hpp"
#include "host/device/stages.hpp"
#include "host/opencl/cl_api.hpp"

namespace ubs::opencl {

class OpenclDevice;

// Number of work-items per group of kernels that process one element per work-item. With 16 work-items per
// group, these kernels reach only half of the memory bandwidth on PoCL.
constexpr std::size_t kFlatGroup = 64;

// Range is the number of work-items in each direction.
struct Range {
  std::size_t x = 1, y = 1, z = 1;
};

// ParameterType describes a declared parameter of a kernel in the terms of clGetKernelArgInfo(). For a vector
// type, `name` is the type of its elements.
struct ParameterType {
  std::string_view name;
  bool pointer, constant;
  unsigned times = 1;  // number of consecutive parameters of this type
};
template <typename Parameter>
constexpr ParameterType parameter_type() {
  using Pointee = std::remove_pointer_t<Parameter>;
  using T = std::remove_cv_t<Pointee>;
  constexpr bool slots = std::is_same_v<T, SlotViews>;
  constexpr std::string_view name = std::is_same_v<T, float> || slots   ? "float"
                                    : std::is_same_v<T, int>            ? "int"
                                    : std::is_same_v<T, std::uint8_t>   ? "uchar"
                                    : std::is_same_v<T, std::uint16_t>  ? "ushort"
                                    : std::is_same_v<T, std::uint32_t>  ? "uint"
                                    : std::is_same_v<T, LossWeights>    ? "LossWeights"
                                    : std::is_same_v<T, PenaltyWeights> ? "PenaltyWeights"
                                                                        : "ulong";
  return {name, std::is_pointer_v<Parameter>, std::is_const_v<Pointee>, slots ? SlotViews::kMaxPieces : 1};
}

// Kernel is a kernel of a built program. Launches are enqueued in order on the device's queue. Example:
//   kernel(Range{global}, Range{local}, records.view(), count);
// Buffers are passed as BufferView<T> (an empty view is a null pointer), and scalars by value with exactly
// the kernel's type. Global sizes must be multiples of local sizes. A launch with a global size of zero does
// nothing.
class Kernel {
 public:
  Kernel() = default;
  Kernel(OpenclDevice& device, cl_program program, std::string name);

  template <typename... Args>
  void operator()(Range global, Range local, const Args&... args) {
    cl_uint index = 0;
    (set(index, args), ...);
    check_count(index);
    launch(global, local);
  }
  // Throws Error(internal) if the types or the number of the compiled parameters differ from `declared`.
  // (Core groups add two more parameters.) Drivers report the types only if kernels are built with
  // UBS_SYNC=1. Without reported types, nothing is checked.
  void check_types(std::span<const ParameterType> declared) const;
  const std::string& name() const { return name_; }
  // Returns the maximum number of work-items of a sub-group in groups of this size, or 0 if the driver does
  // not report it.
  std::size_t sub_group_size(Range group) const;

 private:
  template <typename T>
  void set(cl_uint& index, const BufferView<T>& view) {
    cl_mem memory = memory_of(view.memory);
    set_bytes(index++, sizeof memory, &memory);
  }
  void set(cl_uint& index, const SlotViews& slots) {
    for (const BufferView<float>& piece : slots.pieces) set(index, piece);
    set(index, slots.bits);
  }
  template <typename T>
  requires kKernelValue<T>
  void set(cl_uint& index, const T& value) { set_bytes(index++, sizeof value, &value); }

  static cl_mem memory_of(Memory* memory);
  // Throws Error(device) if groups of the kernel cannot have this many work-items, or if the device has less
  // local memory than the kernel needs. `code` is the error of the failed launch.
  void check_group(std::size_t items, cl_int code) const;
  void check_count(std::size_t given) const;
  void set_bytes(cl_uint index, std::size_t bytes, const void* value);
  void launch(Range global, Range local);

  OpenclDevice* device_ = nullptr;
  std::string name_;
  cl_uint argument_count_ = 0;
  KernelHandle kernel_;
};

// `fits` is true if an argument has the type of the parameter that a kernel declares
// (host/opencl/kernels.hpp).
template <typename Parameter, typename Argument>
inline constexpr bool fits = std::is_same_v<Parameter, Argument>;
template <typename T>
inline constexpr bool fits<T*, BufferView<T>> = true;
template <typename T>
inline constexpr bool fits<const T*, BufferView<T>> = true;
template <>
inline constexpr bool fits<SlotViews*, SlotViews> = true;
template <>
inline constexpr bool fits<const SlotViews*, SlotViews> = true;

// Launch is a kernel that can only be launched with arguments of the types that the kernel declares.
template <typename... Parameters>
struct Launch {
  Kernel& kernel;

  template <typename... Args>
  void operator()(Range global, Range local, const Args&... args) const {
    check<Args...>();
    kernel(global, local, args...);
  }
  template <typename... Args>
  static constexpr void check() {
    static_assert(sizeof...(Parameters) == sizeof...(Args), "wrong number of kernel arguments");
    static_assert((fits<Parameters, Args> && ...), "an argument has the wrong type for its parameter");
  }
};

// Returns the smallest multiple of `multiple` that is at least `value`. It is used for global sizes.
inline std::size_t round_up(std::size_t value, std::size_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace ubs::opencl
