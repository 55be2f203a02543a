// SPDX-License-Identifier: Apache-2.0
// Packs and unpacks the splats of views that several processes render together. The kernels copy the records of a
// process's visible splats to consecutive places for the transfer, and copy the gradients back to all splats. The tile
// rectangle is transferred in two unused values of the record. One work-item processes one splat.

enum { kRectX = kSplatReach + 1, kRectY = kRectX + 1 };

// Writes 1 for a visible splat, and 0 for other splats and for the element after the last splat. The prefix sums of
// these marks are the places of the visible splats.
UBS_KERNEL void mark_drawn(UBS_GLOBAL const uint* tile_counts, uint count, UBS_GLOBAL uint* marks) {
  uint i = UBS_GLOBAL_ID(0);
  if (i > count) return;
  uint drawn = 0;
  if (i < count && tile_counts[i] != 0) drawn = 1;
  marks[i] = drawn;
}

// Copies the records of the visible splats, with their tile rectangles, to their places in `drawn`.
UBS_KERNEL void pick_drawn(UBS_GLOBAL const float* records, UBS_GLOBAL const uint* tile_rects,
                           UBS_GLOBAL const uint* places, uint count, UBS_GLOBAL float* drawn) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count || places[i] == places[i + 1]) return;
  UBS_GLOBAL const uint* from = (UBS_GLOBAL const uint*)records + (size_t)i * kSplatStride;
  UBS_GLOBAL uint* to = (UBS_GLOBAL uint*)drawn + (size_t)places[i] * kSplatStride;
  for (int k = 0; k < kRectX; ++k) to[k] = from[k];
  to[kRectX] = tile_rects[2 * (size_t)i];
  to[kRectY] = tile_rects[2 * (size_t)i + 1];
}

// Restores the depth keys, tile rectangles and tile counts from the records. The kernels that build the lists need
// these values in addition to the records.
UBS_KERNEL void unpack_drawn(UBS_GLOBAL float* records, uint count, UBS_GLOBAL uint* depth_keys,
                             UBS_GLOBAL uint* tile_rects, UBS_GLOBAL uint* tile_counts) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  UBS_GLOBAL uint* record = (UBS_GLOBAL uint*)records + (size_t)i * kSplatStride;
  depth_keys[i] = record[kSplatDepth];
  tile_rects[2 * (size_t)i] = record[kRectX];
  tile_rects[2 * (size_t)i + 1] = record[kRectY];
  tile_counts[i] = tile_rect_area(tile_rect(((UBS_GLOBAL const uint2*)tile_rects)[i]));
  record[kRectX] = record[kRectY] = 0;
}

// Copies the gradients of the visible splats back, and writes 0 for all others.
UBS_KERNEL void spread_gradient(UBS_GLOBAL const float* drawn, UBS_GLOBAL const uint* places, uint count,
                                UBS_GLOBAL float* v_records) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  UBS_GLOBAL float* to = v_records + (size_t)i * kGradStride;
  UBS_GLOBAL const float* from = drawn + (size_t)places[i] * kGradStride;
  if (places[i] == places[i + 1])
    for (int k = 0; k < kGradStride; ++k) to[k] = 0.0f;
  else
    for (int k = 0; k < kGradStride; ++k) to[k] = from[k];
}
