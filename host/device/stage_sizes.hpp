// SPDX-License-Identifier: Apache-2.0
// Sizes of buffers that the devices' kernels decide: what is allocated, and what the memory plan predicts.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "kernels/layout.h"

namespace ubs::stage_sizes {

// Scans and sorts of CPUs go over their elements in chunks. Below this a chunk costs more to launch than to
// sum (2 cores, PoCL: 1.5 us a launch, 1 ns an element).
inline constexpr std::uint64_t kSmallestChunk = 4096;
inline constexpr std::uint64_t kChunksPerCore = 4;  // evens out cores that are busy elsewhere
inline constexpr std::uint64_t kMaxChunks = 256;
inline constexpr std::uint64_t kMaxBins = std::uint64_t{16} << 20;  // (chunk, bin) histogram: 64 MiB

// Depths are sorted by digits of so many bits, from kManySplats on of fewer (measured:
// host/opencl/lists.cpp).
inline constexpr std::uint64_t kManySplats = std::uint64_t{1} << 20;
inline constexpr std::uint32_t kDigitOfFew = 12, kDigitOfMany = 8;

// GPUs: elements of a work-group, and bits of a digit.
inline constexpr std::uint32_t kGroupBlock = 2048;  // kRadixBlock
inline constexpr std::uint32_t kRadixBits = 8;      // the bins are the work-items of a group

// Maps of the loss have a margin of zeros: so many columns, of which 21 left, and the radius of the window in
// rows above and below.
inline constexpr int kMapMargin = 48, kLossRadius = 5;
inline constexpr std::uint64_t kLossTileRows = 16;  // kernels/gpu/loss.cl
// CPUs: pixels up to which all channels are one launch (measured: host/opencl/image_loss.cpp).
inline constexpr std::uint64_t kSmallImage = std::uint64_t{1} << 16;

// GPUs, which go through lists in segments (kernels/gpu/list_segments.h): how many numbers the segments may
// have, and floats of the states of pixels in front of them.
constexpr std::uint64_t list_segments(std::uint64_t tiles, std::uint64_t intersections) {
  return tiles + intersections / kListSegment;
}
constexpr std::uint64_t list_state_floats(std::uint64_t intersections) {
  constexpr std::uint64_t kEach = 4 * kTileSide * kTileSide;
  return (intersections + kListSegment - 1) / kListSegment * kEach;
}
// And draw long ones in parts (kernels/gpu/list_parts.h): floats of what a part hands over, and places of
// parts, 0 where no list can be long, or where the device does not allocate as much as they need.
constexpr std::uint64_t list_part_floats(bool depth) { return (depth ? 7 : 5) * kTileSide * kTileSide; }
constexpr std::uint64_t list_parts(std::uint64_t intersections, bool depth,
                                   std::uint64_t max_allocation_bytes) {
  const std::uint64_t parts = intersections / (kListPart / 2);
  const bool fits = parts * list_part_floats(depth) * sizeof(float) <= max_allocation_bytes;
  return intersections > 2 * kListPart && fits ? parts : 0;
}

// Floats of a gradient slot.
constexpr unsigned slot_floats(RasterKind raster) {
  return raster == RasterKind::cpu ? kGradStride : kCardSlotStride;
}

}  // namespace ubs::stage_sizes
