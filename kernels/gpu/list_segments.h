// SPDX-License-Identifier: Apache-2.0
// GPUs go backward through the list of a tile in segments of kListSegment entries, a group each, so that a long list
// does not keep one group busy while the others have nothing left. The forward rasteriser leaves the state of the tile's
// pixels in front of each segment but the first: float4 (open transmittance, colour composited so far), kTileSide^2 a
// segment.
//
// Segment k of the list that begins at entry `first` has the number first / kListSegment + tile + k, and its states have
// first / kListSegment + k - 1. So no two segments share a number, though some numbers have no segment.
#pragma once

typedef struct {
  int tile;
  uint number;       // in its tile: 0 where there are no states
  uint first, last;  // entries; first = last: none
  uint states;       // number of its states, where `number` > 0
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
