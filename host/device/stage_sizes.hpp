// SPDX-License-Identifier: Apache-2.0
// This file defines the sizes of buffers that depend on the kernels of a device. The stages use these sizes
// to allocate the buffers, and the memory estimate uses them too.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "kernels/layout.h"

namespace ubs::stage_sizes {

// On CPUs, scans and sorts process their elements in chunks. Much smaller chunks would take less time to
// process than to launch: on 2 cores with PoCL, a launch takes 1.5 us, and summing takes 1 ns per element.
inline constexpr std::uint64_t kSmallestChunk = 4096;
inline constexpr std::uint64_t kChunksPerCore = 4;  // several, so that idle cores can process more of them
inline constexpr std::uint64_t kMaxChunks = 256;
// Maximum number of chunks times bins, which limits the histograms of all chunks to 64 MiB.
inline constexpr std::uint64_t kMaxBins = std::uint64_t{16} << 20;

// On CPUs, depths are sorted by digits of kDigitOfFew bits, or of kDigitOfMany bits if there are at least
// kManySplats splats. The comments in host/opencl/lists.cpp explain these numbers.
inline constexpr std::uint64_t kManySplats = std::uint64_t{1} << 20;
inline constexpr std::uint32_t kDigitOfFew = 12, kDigitOfMany = 8;

// On GPUs, a work-group sorts kGroupBlock elements by digits of kRadixBits bits.
inline constexpr std::uint32_t kGroupBlock = 2048;  // kRadixBlock of the kernels
inline constexpr std::uint32_t kRadixBits = 8;      // a work-group has one work-item for each of the 2^8 bins
// On GPUs, the keys of the sort by tile have 16 bits if the image has at most this number of tiles, and 32
// bits otherwise.
inline constexpr int kMaxNarrowTiles = 1 << 16;

// The maps of the loss have a margin of zeros. It has kMapMargin columns, of which 21 are on the left, and
// kLossRadius rows (the radius of the window) above and below the image.
inline constexpr int kMapMargin = 48, kLossRadius = 5;
// Number of rows of a tile of the image loss on GPUs (kernels/gpu/loss.cl).
inline constexpr std::uint64_t kLossTileRows = 16;
// On CPUs, all channels of an image with at most this number of pixels are processed in one launch. The
// comments in host/opencl/image_loss.cpp explain this number.
inline constexpr std::uint64_t kSmallImage = std::uint64_t{1} << 16;

// GPUs process lists in segments (kernels/gpu/list_segments.h). Each segment has a number, which is
// below list_segments(); some numbers are not used. list_state_floats() returns the number of floats for the
// states that the pixels of a tile have before each of its segments.
constexpr std::uint64_t list_segments(std::uint64_t tiles, std::uint64_t intersections) {
  return tiles + intersections / kListSegment;
}
constexpr std::uint64_t list_state_floats(std::uint64_t intersections) {
  constexpr std::uint64_t kEach = 4 * kTileSide * kTileSide;
  return (intersections + kListSegment - 1) / kListSegment * kEach;
}
// GPUs render long lists in parts (kernels/gpu/list_parts.h). list_part_floats() returns the number of floats
// of the results of a part. list_parts() returns the number of places for such results. It is 0 if no list
// can be long, or if the device cannot allocate enough memory for the places.
constexpr std::uint64_t list_part_floats(bool depth) { return (depth ? 7 : 5) * kTileSide * kTileSide; }
constexpr std::uint64_t list_parts(std::uint64_t intersections, bool depth,
                                   std::uint64_t max_allocation_bytes) {
  const std::uint64_t parts = intersections / (kListPart / 2);
  const bool fits = parts * list_part_floats(depth) * sizeof(float) <= max_allocation_bytes;
  return intersections > 2 * kListPart && fits ? parts : 0;
}

// Returns the number of floats of a gradient slot, which stores the gradient of one intersection.
constexpr unsigned slot_floats(RasterKind raster) {
  return raster == RasterKind::cpu ? kGradStride : kCardSlotStride;
}

}  // namespace ubs::stage_sizes
