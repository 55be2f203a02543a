// SPDX-License-Identifier: Apache-2.0
// On GPUs, the backward rasteriser processes the list of a tile in segments of kListSegment entries, with one
// work-group per segment, so that a long list does not keep one work-group busy while the others are idle. The forward
// rasteriser stores the state of the tile's pixels in front of each segment except the first. The state of a pixel is a
// float4. It contains the transmittance so far, or 0 if the pixel is closed (math/blend.h), and the colour composited
// so far. There are kTileSide^2 states per segment.
//
// Segments are numbered over all tiles. If the list of tile t starts at entry f, segment k of this list has the number
// f / kListSegment + t + k. The states of this segment are stored at index f / kListSegment + k - 1, counted in blocks
// of kTileSide^2 states. So no two segments have the same number, although some numbers have no segment.
#pragma once

typedef struct {
  int tile;
  uint number;       // index of the segment within the list of its tile; segment 0 has no states
  uint first, last;  // the entries of the segment are first to last - 1; if first = last, there are none
  uint states;       // index of its states, if `number` > 0
} ListSegment;

UBS_FN uint list_states(uint list_first, uint number) { return list_first / kListSegment + number - 1; }

// Finds the segment with this number by bisection. If there is no such segment, the result has no entries.
UBS_FN ListSegment list_segment(UBS_GLOBAL const uint* tile_ranges, int tiles, uint number) {
  int low = 0, high = tiles;
  while (high - low > 1) {
    int middle = low + (high - low) / 2;
    if (tile_ranges[middle] / kListSegment + (uint)middle <= number)
      low = middle;
    else
      high = middle;
  }
  uint list_first = tile_ranges[low], entries = tile_ranges[low + 1] - list_first;
  ListSegment s;
  s.tile = low;
  s.number = number - (list_first / kListSegment + (uint)low);
  s.states = list_states(list_first, s.number);
  uint skipped = s.number <= entries / kListSegment ? s.number * kListSegment : entries;
  s.first = list_first + skipped;
  s.last = entries - skipped > kListSegment ? s.first + kListSegment : list_first + entries;
  return s;
}
