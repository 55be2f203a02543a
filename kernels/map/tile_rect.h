// SPDX-License-Identifier: Apache-2.0
// The functions of this file read the data from which tile lists are built: the rectangle of tiles of a splat, and
// numbers of elements. A rectangle is stored in two words, x0 | x1 << 16 and y0 | y1 << 16. Both ends are inclusive.

typedef struct {
  uint x0, x1, y0, y1;
} TileRect;

UBS_FN TileRect tile_rect(uint2 packed) {
  TileRect rect = {packed.x & 0xffffu, packed.x >> 16, packed.y & 0xffffu, packed.y >> 16};
  return rect;
}

UBS_FN uint tile_rect_width(TileRect rect) { return rect.x1 - rect.x0 + 1; }
UBS_FN uint tile_rect_area(TileRect rect) { return tile_rect_width(rect) * (rect.y1 - rect.y0 + 1); }

// Returns the number of elements that a kernel processes. If the host knows this number, it passes it as `most`, and
// `counted` is null. Otherwise the number is stored on the device at `counted`, and `most` is an upper bound. In this
// case the launch has work-items for `most` elements, and the work-items beyond the actual number have nothing to do.
UBS_FN uint listed(uint most, UBS_GLOBAL const uint* counted) { return counted ? *counted : most; }

// Returns the index i in [low, high) with firsts[i] <= place < firsts[i + 1]. The values of `firsts` must be strictly
// ascending.
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
