// SPDX-License-Identifier: Apache-2.0
// Segments of lists. On GPUs the backward rasteriser processes the list of a tile in segments of kListSegment entries,
// with one work-group per segment, so that a long list does not keep one work-group busy while the others are idle. The
// forward rasteriser stores the state of the tile's pixels in front of each segment except the first. A state is a
// float4 (open transmittance, colour composited so far), and there are kTileSide^2 of them per segment.
//
// Segment k of a list that starts at entry `first` has the number first / kListSegment + tile + k. Its states have the
// number first / kListSegment + k - 1. So no two segments have the same number, although some numbers have no segment.
#pragma once

typedef struct {
  int tile;
  uint number;       // within its tile; segment 0 has no states
  uint first, last;  // entries of the list; first = last: no entries
  uint states;       // number of its states, if `number` > 0
} ListSegment;

UBS_FN uint list_states(uint list_first, uint number) { return list_first / kListSegment + number - 1; }

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
