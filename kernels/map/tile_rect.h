// SPDX-License-Identifier: Apache-2.0
// The data that tile lists are built from: a splat's rectangle of tiles (x0 | x1 << 16, y0 | y1 << 16, both ends
// inclusive), and the number of elements.

typedef struct {
  uint x0, x1, y0, y1;
} TileRect;

UBS_FN TileRect tile_rect(uint2 packed) {
  TileRect rect = {packed.x & 0xffffu, packed.x >> 16, packed.y & 0xffffu, packed.y >> 16};
  return rect;
}

UBS_FN uint tile_rect_width(TileRect rect) { return rect.x1 - rect.x0 + 1; }
UBS_FN uint tile_rect_area(TileRect rect) { return tile_rect_width(rect) * (rect.y1 - rect.y0 + 1); }

// Returns a number of elements. It is `most`, or, if only the device knows the number, the value stored at `counted`,
// which is at most `most`. In the second case the launch has work-items for the whole capacity of the buffers, and
// those beyond the number do nothing.
UBS_FN uint listed(uint most, UBS_GLOBAL const uint* counted) { return counted ? *counted : most; }

// Returns the i in [low, high) with firsts[i] <= place < firsts[i + 1]. The values of firsts are strictly ascending.
UBS_FN uint find_owner(UBS_GLOBAL const uint* firsts, uint low, uint high, size_t place) {
  while (high - low > 1) {
    uint middle = low + (high - low) / 2;
    if (firsts[middle] <= place)
      low = middle;
    else
      high = middle;
  }
  return low;
}
