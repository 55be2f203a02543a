// SPDX-License-Identifier: Apache-2.0
// Reading a splat's rectangle of tiles (x0 | x1 << 16, y0 | y1 << 16, both ends inclusive).
#pragma once

typedef struct {
  uint x0, x1, y0, y1;
} TileRect;

static inline TileRect tile_rect(uint2 packed) {
  TileRect rect = {packed.x & 0xffffu, packed.x >> 16, packed.y & 0xffffu, packed.y >> 16};
  return rect;
}

static inline uint tile_rect_width(TileRect rect) { return rect.x1 - rect.x0 + 1; }
static inline uint tile_rect_area(TileRect rect) { return tile_rect_width(rect) * (rect.y1 - rect.y0 + 1); }
