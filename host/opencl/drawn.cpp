// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/drawn.hpp"

namespace ubs::opencl {
namespace {

Range items(std::uint64_t count) { return {round_up(count, kFlatGroup)}; }

}  // namespace

DrawnKernels::DrawnKernels(OpenclDevice& device, const KernelConfig& config)
    : device_(device), kernels_(device, {{"map/tile_rect.h", "map/drawn.cl"}, {}}), scan_(device, config) {}

std::uint32_t DrawnKernels::place(const PlaceDrawn& a) {
  kernels_[kMarkDrawn](items(a.count + std::uint64_t{1}), {kFlatGroup}, a.tile_counts, a.count, a.places);
  if (a.count == 0) return 0;
  scan_.exclusive(a.places, a.places, a.count);
  std::uint32_t drawn = 0;
  device_.read(*a.places.memory, a.count * sizeof(drawn), std::as_writable_bytes(std::span(&drawn, 1)));
  return drawn;
}

void DrawnKernels::pick(const PickDrawn& a) {
  if (a.count == 0) return;
  kernels_[kPickDrawn](items(a.count), {kFlatGroup}, a.records, a.tile_rects, a.places, a.count, a.drawn);
}

void DrawnKernels::unpack(const UnpackDrawn& a) {
  if (a.count == 0) return;
  kernels_[kUnpackDrawn](items(a.count), {kFlatGroup}, a.records, a.count, a.depth_keys, a.tile_rects,
                         a.tile_counts);
}

void DrawnKernels::spread(const SpreadGradient& a) {
  if (a.count == 0) return;
  kernels_[kSpreadGradient](items(a.count), {kFlatGroup}, a.drawn, a.places, a.count, a.v_records);
}

}  // namespace ubs::opencl
