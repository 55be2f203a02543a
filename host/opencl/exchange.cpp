// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/exchange.hpp"

namespace ubs::opencl {
namespace {

constexpr std::size_t kRow = 16;

}  // namespace

Exchange exchange_kind(std::string_view extensions, std::string_view subgroup_language) {
  if (has_word(extensions, "cl_khr_subgroup_shuffle") && !subgroup_language.empty()) return Exchange::khr;
  // What these two name is their own drivers, whose compilers know the instructions.
  if (has_word(extensions, "cl_nv_device_attribute_query")) return Exchange::nvidia;
  if (has_word(extensions, "cl_amd_device_attribute_query")) return Exchange::amd;
  return Exchange::none;
}

Exchange exchange_kind(const OpenclDevice& device) {
  if (device.info().type == DeviceType::cpu && device.on_pocl_cpu()) return Exchange::none;
  return exchange_kind(device_text(device.id(), CL_DEVICE_EXTENSIONS), device.info().subgroup_language);
}

Options exchange_options(const OpenclDevice& device, Exchange kind) {
  Options options{fmt::format("-DUBS_SUBGROUPS={}", static_cast<int>(kind))};
  if (kind == Exchange::khr) options.push_back("-cl-std=" + device.info().subgroup_language);
  return options;
}

bool in_rows(const Kernel& kernel, Exchange kind, Range group) {
  if (kind != Exchange::khr) return kind != Exchange::none;  // waves of 32 or 64
  return kernel.sub_group_size(group) >= kRow && kernel.sub_group_size(group) % kRow == 0;
}

}  // namespace ubs::opencl
