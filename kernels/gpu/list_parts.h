// SPDX-License-Identifier: Apache-2.0
// On GPUs, a tile's list with more than kLongList entries is rendered in parts of kListPart entries, with one
// work-group per part, so that a long list does not keep one work-group busy while the others are idle. The
// contribution of a part depends on the parts in front of it only through their transmittance. Therefore there are
// three passes. The first pass computes the transmittance of each part. The second pass computes the colours of all
// parts; each part starts with the product of the transmittances of the parts in front of it. The third pass adds the
// colours of the parts.
//
// The results of a part are stored at its place, which is an index into a buffer that all lists share. Part k of a list
// that starts at entry `first` has the place first / (kListPart / 2) + k. No two parts of long lists have the same
// place, because a list with more than kLongList entries has at most as many parts as it has places of its own.
#pragma once

enum { kPartPlanes = UBS_DEPTH ? 7 : 5 };  // planes of kTileSide^2 floats per part

typedef struct {
  int tile;
  uint list;           // first entry of the tile's list
  // Index of the part in its list, and number of parts of the list. A list that is not long has one part. If
  // number >= count, the part does not exist.
  uint number, count;
  uint first, last;    // the entries of the part are first to last - 1
  uint place;          // place of the results of the part, see above
} ListPart;

// Returns part `number` of the list of a tile. If `divides` is 0, even long lists have only one part.
UBS_FN ListPart part_of_list(UBS_GLOBAL const uint* tile_ranges, int tile, uint number, int divides) {
  ListPart p;
  p.tile = tile;
  p.list = tile_ranges[tile];
  uint end = tile_ranges[tile + 1];
  p.count = divides && end - p.list > kLongList ? (end - p.list + kListPart - 1) / kListPart : 1;
  p.number = number;
  p.first = p.list + number * kListPart;
  p.last = number + 1 < p.count ? p.first + kListPart : end;
  p.place = p.list / (kListPart / 2) + number;
  return p;
}

// Finds the part with this place by bisection. If there is no such part, the result has number >= count.
UBS_FN ListPart list_part(UBS_GLOBAL const uint* tile_ranges, int tiles, uint place) {
  int low = 0, high = tiles;
  while (high - low > 1) {
    int middle = low + (high - low) / 2;
    if (tile_ranges[middle] / (kListPart / 2) <= place)
      low = middle;
    else
      high = middle;
  }
  return part_of_list(tile_ranges, low, place - tile_ranges[low] / (kListPart / 2), 1);
}
