// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/exchange.hpp"

#include <vector>

namespace ubs::opencl {
namespace {

constexpr std::size_t kRow = 16;  // number of lanes that exchange values with each other

}  // namespace

Exchange exchange_kind(std::string_view extensions, std::string_view subgroup_language) {
  if (has_word(extensions, "cl_khr_subgroup_shuffle") && !subgroup_language.empty()) return Exchange::khr;
  // Only the drivers of NVIDIA and AMD have these extensions. Their compilers support the instructions.
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

std::string fault_of_rows(const Kernel& kernel, Exchange kind, Range group) {
  if (kind != Exchange::khr) return "";  // these devices have waves of 32 or 64 lanes
  const std::size_t size = kernel.sub_group_size(group);
  if (size == 0) return "the driver does not report the size of sub-groups";
  return size % kRow == 0
             ? ""
             : fmt::format("the number of work-items of a sub-group is {}, which is not a multiple of {}",
                           size, kRow);
}

std::string fault_of_values(OpenclDevice& device, Kernel check) {
  constexpr int kVisits = 16, kBlocks = 16, kSums = 10, kGroup = 256;  // as in kernels/gpu/exchange_check.cl
  const auto value = [](int item, int visit, int i) { return (item * 7 + visit * 3 + i * 5) % 64; };
  Buffer<float> sums(device, "check of the lane exchange", kVisits * kBlocks * kSums);
  sums.zero();
  check(Range{kGroup}, Range{kGroup}, sums.view());
  const std::vector<float> computed = sums.download();
  auto at = computed.begin();
  for (int visit = 0; visit < kVisits; ++visit)
    for (int block = 0; block < kBlocks; ++block)
      for (int i = 0; i < kSums; ++i) {
        int expected = 0;
        for (int lane = 0; lane < static_cast<int>(kRow) && visit < kVisits - block; ++lane)
          expected += value(block * static_cast<int>(kRow) + lane, visit, i);
        if (*at++ != static_cast<float>(expected)) return "the lane exchange gives wrong values";
      }
  return "";
}

}  // namespace ubs::opencl
