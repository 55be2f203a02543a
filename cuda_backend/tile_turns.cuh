// SPDX-License-Identifier: Apache-2.0
// Which tiles a block draws:
//   UBS_EACH_TILE(tile, tiles, order, taken) { ... }
// Without UBS_TILE_TURNS tile n is block n's alone, and there is no loop. With it tiles have turns, 0 ... tiles - 1:
// `order` says whose turn it is (null: their own order). A grid of as many blocks as tiles has a turn a block; of fewer
// blocks each begins with its own turn and takes the next one that is left when it is done, so that no part of the card
// is idle while there are tiles. A tile's result does not depend on its turn.

#ifdef UBS_TILE_TURNS
// -1: there is none left; the same in the whole block.
__device__ __forceinline__ int tile_of_turn(unsigned turn, unsigned tiles, const unsigned* order) {
  if (turn >= tiles) return -1;
  return static_cast<int>(order ? order[turn] : turn);
}
// taken: turns taken beyond the first ones; 0 before the launch and after it. Every block takes one after each of its
// tiles, the last time one that is none: as many as there are tiles, and who takes the last leaves 0 again.
__device__ __forceinline__ int next_tile(unsigned tiles, const unsigned* order, unsigned* taken) {
  __shared__ unsigned turn;
  if (gridDim.x == tiles) return -1;
  __syncthreads();  // all are done with the tile's shared memory, and with the turn before
  if (threadIdx.x == 0) {
    const unsigned before = atomicAdd(taken, 1u);
    if (before + 1 == tiles) *taken = 0;
    turn = gridDim.x + before;
  }
  __syncthreads();
  return tile_of_turn(turn, tiles, order);
}
#define UBS_EACH_TILE(tile, tiles, order, taken)                   \
  for (int tile = tile_of_turn(blockIdx.x, tiles, order); tile >= 0; \
       tile = next_tile(tiles, order, taken))
#else
#define UBS_EACH_TILE(tile, tiles, order, taken) const int tile = static_cast<int>(blockIdx.x);
#endif
