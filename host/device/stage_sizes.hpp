// SPDX-License-Identifier: Apache-2.0
// Sizes of buffers that depend on the kernels of a device. The stages allocate them, and the memory estimate
// uses them.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "kernels/layout.h"

namespace ubs::stage_sizes {

// On CPUs, scans and sorts process their elements in chunks. It takes longer to launch a chunk below this
// size than to sum it (2 cores, PoCL: 1.5 us per launch, 1 ns per element).
inline constexpr std::uint64_t kSmallestChunk = 4096;
inline constexpr std::uint64_t kChunksPerCore = 4;  // several, for balance if cores are busy with other work
inline constexpr std::uint64_t kMaxChunks = 256;
inline constexpr std::uint64_t kMaxBins = std::uint64_t{16} << 20;  // (chunk, bin) histogram: 64 MiB

// Depths are sorted by digits of kDigitOfFew bits, or of kDigitOfMany bits if there are at least kManySplats
// splats (measured: host/opencl/lists.cpp).
inline constexpr std::uint64_t kManySplats = std::uint64_t{1} << 20;
inline constexpr std::uint32_t kDigitOfFew = 12, kDigitOfMany = 8;

// GPUs: number of elements per work-group, and number of bits per digit.
inline constexpr std::uint32_t kGroupBlock = 2048;  // kRadixBlock
inline constexpr std::uint32_t kRadixBits = 8;      // there is one bin per work-item of a group

// Maps of the loss have a margin of zeros: kMapMargin columns, 21 of them on the left, and as many rows above
// and below as the radius of the window.
inline constexpr int kMapMargin = 48, kLossRadius = 5;
inline constexpr std::uint64_t kLossTileRows = 16;  // kernels/gpu/loss.cl
// CPUs: for images with up to this number of pixels, all channels are processed in one launch (measured:
// host/opencl/image_loss.cpp).
inline constexpr std::uint64_t kSmallImage = std::uint64_t{1} << 16;

// GPUs process lists in segments (kernels/gpu/list_segments.h). These functions return the range of segment
// numbers, and the number of floats for the states of pixels in front of the segments.
constexpr std::uint64_t list_segments(std::uint64_t tiles, std::uint64_t intersections) {
  return tiles + intersections / kListSegment;
}
constexpr std::uint64_t list_state_floats(std::uint64_t intersections) {
  constexpr std::uint64_t kEach = 4 * kTileSide * kTileSide;
  return (intersections + kListSegment - 1) / kListSegment * kEach;
}
// GPUs render long lists in parts (kernels/gpu/list_parts.h). These functions return the number of floats
// that a part stores, and the number of places for parts. The latter is 0 if no list can be long, or if the
// device cannot allocate enough memory for them.
constexpr std::uint64_t list_part_floats(bool depth) { return (depth ? 7 : 5) * kTileSide * kTileSide; }
constexpr std::uint64_t list_parts(std::uint64_t intersections, bool depth,
                                   std::uint64_t max_allocation_bytes) {
  const std::uint64_t parts = intersections / (kListPart / 2);
  const bool fits = parts * list_part_floats(depth) * sizeof(float) <= max_allocation_bytes;
  return intersections > 2 * kListPart && fits ? parts : 0;
}

// Returns the number of floats of a gradient slot.
constexpr unsigned slot_floats(RasterKind raster) {
  return raster == RasterKind::cpu ? kGradStride : kCardSlotStride;
}

}  // namespace ubs::stage_sizes
