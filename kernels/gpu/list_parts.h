// SPDX-License-Identifier: Apache-2.0
// GPUs draw the list of a tile in parts of kListPart entries, a group each, where it has more than kLongList of them, so
// that a long list does not keep one group busy while the others have nothing left. What is behind a part does not
// depend on where its pixels are finished, so there are three passes: the transmittance of each part, the colours of all
// parts, each from the product of the transmittances in front of it, and their sum.
//
// Part k of the list that begins at entry `first` has the place first / (kListPart / 2) + k. Lists of kLongList entries or
// more have at most as many parts as places.
#pragma once

enum { kPartPlanes = UBS_DEPTH ? 7 : 5 };  // of kTileSide^2 floats

typedef struct {
  int tile;
  uint list;           // first entry of the tile's list
  uint number, count;  // of the parts of the list, 1 where it is not long; number >= count: there is none
  uint first, last;    // entries
  uint place;
} ListPart;

// divides: whether lists are divided at all.
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

// The part at a place, by bisection; number >= count where there is none.
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
