// SPDX-License-Identifier: Apache-2.0
// These kernels compute the L1 + SSIM loss of an image and its gradient, with OpenCL and with CUDA. The formulas are in
// kernels/math/loss.h. One work-group processes one tile of one channel. The window sums are separable: they are
// computed along columns into local memory first, then along rows. On CPUs a work-group is one work-item with UBS_VW
// lanes; on GPUs (UBS_VW = 1) LOSS_GROUP work-items share the loops.
//
//   loss_margins     writes zeros around the maps, after the shape of the images has changed
//   loss_window      image, target -> sums of the tile; if a gradient is requested, also the three maps of
//                    ssim_point(), with one plane per channel, padded with zeros by the radius of the window
//   loss_gradient    maps, image, target -> v_image, the gradient of the image
//   loss_total       sums of the tiles -> the eight results of the stage (ImageLoss::sums of host/device/stages.hpp)
//
// With UBS_LOSS_MASK, pixels whose mask is 0 are treated as if they were outside the image: they are zero in the
// windows of their neighbours, and have no window and no gradient of their own.
//
// The tile is as wide as local memory allows.

// Tuned constants (host/opencl/opencl_tuning.cpp). The host defines those constants that its launches depend on. The
// widths of tiles must be multiples of 16, and UBS_LOSS_STRIP must divide LOSS_TILE_Y.
#ifndef UBS_LOSS_TILE
#define UBS_LOSS_TILE 112
#endif
#ifndef UBS_LOSS_TILE_GPU
#define UBS_LOSS_TILE_GPU 32
#endif
#ifndef UBS_LOSS_GROUP
#define UBS_LOSS_GROUP 128
#endif
#ifndef UBS_LOSS_STRIP
#define UBS_LOSS_STRIP 4
#endif
#if UBS_VW == 1
#define LOSS_TILE_X UBS_LOSS_TILE_GPU
#define LOSS_GROUP UBS_LOSS_GROUP
#else
#define LOSS_TILE_X UBS_LOSS_TILE
#define LOSS_GROUP 1
#endif
#define LOSS_TILE_Y 16
// LOSS_PART is the number of rows that are summed along columns before they are summed along rows. If a work-group has
// a single work-item, it proceeds strip by strip, so that the intermediate sums stay in the first-level cache.
#if LOSS_GROUP == 1
#define LOSS_PART LOSS_STRIP
#define LOSS_BARRIER
#define LOSS_TEAM 1
#else
#define LOSS_TEAM 16  // work-items that add the sums of all work-items of a group
#define LOSS_PART LOSS_TILE_Y
#define LOSS_BARRIER UBS_BARRIER();
#endif
#define LOSS_STRIP \
  UBS_LOSS_STRIP  // number of rows that one work-item sums at once along columns; it reads LOSS_STRIP + 10 rows
// Columns of a tile including the halo of the window, rounded up to whole vectors.
#define LOSS_COLUMNS ((LOSS_TILE_X + 2 * kSsimRadius + UBS_VW - 1) / UBS_VW * UBS_VW)
#define LOSS_ROWS (LOSS_TILE_Y + 2 * kSsimRadius)
// Number of zero columns on the left side of each plane of the maps. It is chosen such that loads of windows are
// aligned to whole vectors, because windows are loaded three times as often as pixels are stored. The host reserves
// kMapMargin zero columns per row. The remaining ones are on the right side, and there are at least kSsimRadius of
// them.
#define LOSS_MAP_MARGIN (16 + kSsimRadius)
#define LOSS_SHARES 64  // number of partial sums per channel in loss_total
#define LOSS_TOTAL_GROUP (LOSS_GROUP == 1 ? LOSS_SHARES : 3 * LOSS_SHARES)

UBS_CONSTANT real kWindow[kSsimTaps] = UBS_SSIM_WEIGHTS;

typedef struct {
  int width, height, pitch, rows, channel;
} LossShape;

// The target is 8 bit if `bytes` is not null, otherwise float. Its planes are not padded.
typedef struct {
  UBS_GLOBAL const float* image;
  UBS_GLOBAL const uchar* bytes;
  UBS_GLOBAL const float* values;
  float low, high;             // the image is clamped to this range
  UBS_GLOBAL const uchar* mask;  // with UBS_LOSS_MASK: one plane for all channels, not padded
} LossPixels;

typedef struct {
  vreal u, v;
} LossPair;

UBS_FN LossPixels channel_pixels(LossPixels p, LossShape s) {
  size_t plane = (size_t)s.channel * s.width * s.height;
  p.image += (size_t)s.channel * s.pitch * s.rows;
  if (p.bytes) p.bytes += plane;
  if (p.values) p.values += plane;
  return p;
}

UBS_FN real target_at(LossPixels p, LossShape s, int x, int y) {
  size_t i = (size_t)y * s.width + x;
  return p.bytes ? (real)p.bytes[i] * R(0.00392156862745098) : p.values[i];
}

UBS_FN bool pixel_counts(LossPixels p, LossShape s, int x, int y) {
  bool inside = x >= 0 && x < s.width && y >= 0 && y < s.height;
#ifdef UBS_LOSS_MASK
  return inside && p.mask[(size_t)y * s.width + x] != 0;
#else
  (void)p;
  return inside;
#endif
}

UBS_FN LossPair make_pair(vreal image, vreal target, LossPixels p, real shift) {
  LossPair pair;
  image = image < (vreal)(p.low) ? (vreal)(p.low) : image;
  image = image > (vreal)(p.high) ? (vreal)(p.high) : image;
  pair.u = (image - shift) + (target - shift);
  pair.v = image - target;
  return pair;
}

#if UBS_VW > 1
// Returns `pixels` shifted by `by` columns: lane i of the result is lane i + by of `pixels`, or zero if there is no
// such lane.
UBS_FN vreal shifted(vreal pixels, int by) {
  real lanes[3 * UBS_VW];
  UBS_STORE(V(0.0), lanes);
  UBS_STORE(pixels, lanes + UBS_VW);
  UBS_STORE(V(0.0), lanes + 2 * UBS_VW);
  return UBS_LOAD(lanes + UBS_VW + by);
}

typedef struct {
  vreal seen, target;
} LossLanes;

// Loads UBS_VW pixels of row y, starting at column x. All of them must be inside the image. Masked pixels become zero.
UBS_FN LossLanes load_inside(LossPixels p, LossShape s, int x, int y) {
  size_t i = (size_t)y * s.width + x;
  LossLanes lanes;
  lanes.target =
      p.bytes ? UBS_TO_VREAL(UBS_LOAD(p.bytes + i)) * V(0.00392156862745098) : UBS_LOAD(p.values + i);
  lanes.seen = UBS_LOAD(p.image + (size_t)y * s.pitch + x);
#ifdef UBS_LOSS_MASK
  vmask counts = UBS_TO_VREAL(UBS_LOAD(p.mask + i)) > V(0.0);
  lanes.seen = counts ? lanes.seen : V(0.0);
  lanes.target = counts ? lanes.target : V(0.0);
#endif
  return lanes;
}
#endif

// Loads UBS_VW pixels of row y, starting at column x. Masked pixels and pixels outside the image become zero.
UBS_FN LossPair load_pair(LossPixels p, LossShape s, int x, int y, real shift) {
  bool row = y >= 0 && y < s.height;
#if UBS_VW > 1
  if (!row) return make_pair(V(0.0), V(0.0), p, shift);
  // At the sides of the image, load the nearest vector inside it and shift it. Loading lane by lane took a quarter of
  // the total time for an image of 200 x 200.
  if (s.width >= UBS_VW) {
    int inside = clamp(x, 0, s.width - UBS_VW), by = clamp(x - inside, -UBS_VW, UBS_VW);
    LossLanes lanes = load_inside(p, s, inside, y);
    if (by != 0) {
      lanes.seen = shifted(lanes.seen, by);
      lanes.target = shifted(lanes.target, by);
    }
    return make_pair(lanes.seen, lanes.target, p, shift);
  }
#endif
  real image[UBS_VW], target[UBS_VW];
  for (int i = 0; i < UBS_VW; ++i) {
    bool inside = row && pixel_counts(p, s, x + i, y);
    image[i] = inside ? p.image[(size_t)y * s.pitch + x + i] : R(0.0);
    target[i] = inside ? target_at(p, s, x + i, y) : R(0.0);
  }
  return make_pair(UBS_LOAD(image), UBS_LOAD(target), p, shift);
}

// Returns a mask of the lanes whose pixel counts. A pixel counts if it is inside the image and not masked.
UBS_FN vmask pixels_count(LossPixels p, LossShape s, int x, int y) {
  vmask inside = ubs_lane_indices((uint)x) < (vuint)((uint)(y < s.height ? s.width : 0));
#ifdef UBS_LOSS_MASK
  real counts[UBS_VW];
  for (int i = 0; i < UBS_VW; ++i) counts[i] = pixel_counts(p, s, x + i, y) ? R(1.0) : R(0.0);
  return inside & (UBS_LOAD(counts) > V(0.0));
#else
  (void)p;
  return inside;
#endif
}

// Returns the sum of the lanes, added in a fixed order.
UBS_FN real sum_lanes(vreal value) {
  real lanes[UBS_VW];
  UBS_STORE(value, lanes);
  for (int width = UBS_VW / 2; width > 0; width /= 2)
    for (int i = 0; i < width; ++i) lanes[i] += lanes[i + width];
  return lanes[0];
}

// Returns the number of vectors that cover `columns` pixels and the halo of the window on both sides.
UBS_FN int halo_vectors(int columns) { return (columns + 2 * kSsimRadius + UBS_VW - 1) / UBS_VW; }

// Returns the number of columns of a tile that the loops visit. On GPUs this is the full width, which avoids divisions
// by a variable; the loops skip columns beyond the pitch.
UBS_FN int tile_columns(int x0, int pitch) {
  return LOSS_GROUP > 1 ? LOSS_TILE_X : ubs_min(LOSS_TILE_X, pitch - x0);
}

// ---- Window sums and the point formula ----

#if UBS_VW > 1
// Loads a row of a tile that starts at column `left`. Columns `begin` to `end` - 1 come from the image; the others are
// zero.
UBS_FN void load_row(LossPixels p, LossShape s, int left, int begin, int end, int y, int vectors,
                            real shift, UBS_LOCAL real* u, UBS_LOCAL real* v) {
  LossPair nothing = make_pair(V(0.0), V(0.0), p, shift);
  bool row = y >= 0 && y < s.height;
  if (!row) begin = end = left;
  for (int column = 0; column < begin - left; column += UBS_VW) {
    UBS_STORE(nothing.u, u + column);
    UBS_STORE(nothing.v, v + column);
  }
  for (int column = (vectors - 1) * UBS_VW; column > end - left - UBS_VW; column -= UBS_VW) {
    UBS_STORE(nothing.u, u + column);
    UBS_STORE(nothing.v, v + column);
  }
  for (int x = begin; x < end; x += UBS_VW) {
    int from = min(x, end - UBS_VW);
    LossLanes lanes = load_inside(p, s, from, y);
    LossPair pair = make_pair(lanes.seen, lanes.target, p, shift);
    UBS_STORE(pair.u, u + from - left);
    UBS_STORE(pair.v, v + from - left);
  }
}
#endif

UBS_FN void load_tile(LossPixels p, LossShape s, int x0, int y0, int vectors, real shift,
                             UBS_LOCAL real* u, UBS_LOCAL real* v) {
#if LOSS_GROUP == 1 && UBS_VW > 1
  int left = x0 - kSsimRadius, begin = max(left, 0), end = min(left + vectors * UBS_VW, s.width);
  if (end - begin >= UBS_VW) {
    for (int row = 0; row < LOSS_ROWS; ++row)
      load_row(p, s, left, begin, end, y0 + row - kSsimRadius, vectors, shift, u + row * LOSS_COLUMNS,
               v + row * LOSS_COLUMNS);
    return;
  }
#endif
  for (int item = ubs_local_id(); item < LOSS_ROWS * vectors; item += LOSS_GROUP) {
    int row = item / vectors, column = (item - row * vectors) * UBS_VW;
    LossPair pair = load_pair(p, s, x0 + column - kSsimRadius, y0 + row - kSsimRadius, shift);
    UBS_STORE(pair.u, u + row * LOSS_COLUMNS + column);
    UBS_STORE(pair.v, v + row * LOSS_COLUMNS + column);
  }
}

// Computes the window sums along columns for LOSS_PART rows. u and v start at the first row of the first window.
// `means` receives the sums of u, v, u^2 and v^2, in four planes of LOSS_PART x LOSS_COLUMNS.
UBS_FN void sum_columns(UBS_LOCAL const real* u, UBS_LOCAL const real* v, int vectors,
                               UBS_LOCAL real* means) {
  for (int item = ubs_local_id(); item < LOSS_PART / LOSS_STRIP * vectors; item += LOSS_GROUP) {
    int strip = item / vectors, row = strip * LOSS_STRIP, column = (item - strip * vectors) * UBS_VW;
    vreal sum_u[LOSS_STRIP], sum_v[LOSS_STRIP], sum_uu[LOSS_STRIP], sum_vv[LOSS_STRIP];
UBS_UNROLL
    for (int k = 0; k < LOSS_STRIP; ++k) sum_u[k] = sum_v[k] = sum_uu[k] = sum_vv[k] = V(0.0);
UBS_UNROLL
    for (int t = 0; t < LOSS_STRIP + 2 * kSsimRadius; ++t) {
      vreal pu = UBS_LOAD(u + (row + t) * LOSS_COLUMNS + column);
      vreal pv = UBS_LOAD(v + (row + t) * LOSS_COLUMNS + column);
      vreal uu = pu * pu, vv = pv * pv;
UBS_UNROLL
      for (int k = 0; k < LOSS_STRIP; ++k) {
        if (t < k || t - k >= kSsimTaps) continue;
        vreal w = (vreal)(kWindow[t - k]);
        sum_u[k] += w * pu;
        sum_v[k] += w * pv;
        sum_uu[k] += w * uu;
        sum_vv[k] += w * vv;
      }
    }
UBS_UNROLL
    for (int k = 0; k < LOSS_STRIP; ++k) {
      UBS_LOCAL real* out = means + (row + k) * LOSS_COLUMNS + column;
      UBS_STORE(sum_u[k], out);
      UBS_STORE(sum_v[k], out + LOSS_PART * LOSS_COLUMNS);
      UBS_STORE(sum_uu[k], out + 2 * LOSS_PART * LOSS_COLUMNS);
      UBS_STORE(sum_vv[k], out + 3 * LOSS_PART * LOSS_COLUMNS);
    }
  }
}

// Returns the sums of the windows that start at UBS_VW consecutive columns of a row of sums.
UBS_FN vreal sum_window(UBS_LOCAL const real* row) {
  vreal sum = V(0.0);
#if UBS_VW == 16 && defined(UBS_POCL)
  // Loads two whole cache lines and combines them with shifts. Of eleven separate loads, ten would be unaligned and
  // cross a cache line.
  const vreal a = UBS_LOAD(row), b = UBS_LOAD(row + 16);
#define LOSS_TAP(k)                                                                                         \
  sum += (vreal)(kWindow[k]) * __builtin_shufflevector(a, b, k, k + 1, k + 2, k + 3, k + 4, k + 5, k + 6,   \
                                                       k + 7, k + 8, k + 9, k + 10, k + 11, k + 12, k + 13, \
                                                       k + 14, k + 15);
  LOSS_TAP(0)
  LOSS_TAP(1)
  LOSS_TAP(2)
  LOSS_TAP(3)
  LOSS_TAP(4)
  LOSS_TAP(5)
  LOSS_TAP(6)
  LOSS_TAP(7)
  LOSS_TAP(8)
  LOSS_TAP(9)
  LOSS_TAP(10)
#undef LOSS_TAP
#else
UBS_UNROLL
  for (int k = 0; k < kSsimTaps; ++k) sum += (vreal)(kWindow[k]) * UBS_LOAD(row + k);
#endif
  return sum;
}

// Returns the means of UBS_VW consecutive windows. `means` points to the first column of the first window in the result
// of sum_columns().
UBS_FN SsimMeans sum_row(UBS_LOCAL const real* means) {
  SsimMeans m;
  m.u = sum_window(means);
  m.v = sum_window(means + LOSS_PART * LOSS_COLUMNS);
  m.uu = sum_window(means + 2 * LOSS_PART * LOSS_COLUMNS);
  m.vv = sum_window(means + 3 * LOSS_PART * LOSS_COLUMNS);
  return m;
}

// Returns the shift of a tile: the target in its middle. This is close to the pixels' values if they vary little, and
// the shift only matters in this case (see SsimMeans). If the pixel in the middle is masked, the shift is 0.5.
UBS_FN real tile_shift(LossPixels p, LossShape s, int x0, int y0) {
  int x = ubs_min(x0 + LOSS_TILE_X / 2, s.width - 1);
  int y = ubs_min(y0 + LOSS_TILE_Y / 2, s.height - 1);
  if (!pixel_counts(p, s, x, y)) return R(0.5);  // the pixel is masked
  return target_at(p, s, x, y);
}

// LossTile is the tile that a work-group processes. On GPUs the work-groups form a grid of three dimensions: tiles per
// row, rows of tiles, and channels. On CPUs the work-groups are ordered by row of tiles, then by channel, so that a
// core with consecutive work-groups processes consecutive rows of the image.
typedef struct {
  int x, y, across, plane;
} LossTile;

#if LOSS_GROUP > 1
#define LOSS_THIS_TILE grid_tile()
UBS_FN LossTile grid_tile(void) {
  LossTile tile = {(int)ubs_group_at(0), (int)ubs_group_at(1), (int)ubs_groups_across(), (int)ubs_group_at(2)};
  return tile;
}
#else
#define LOSS_THIS_TILE loss_tile(UBS_CORE_GROUP, pitch, channels)
UBS_FN LossTile loss_tile(uint group, int pitch, int channels) {
  LossTile tile;
  tile.across = (pitch + LOSS_TILE_X - 1) / LOSS_TILE_X;
  tile.x = (int)group % tile.across;
  tile.plane = (int)group / tile.across % channels;
  tile.y = (int)group / tile.across / channels;
  return tile;
}
#endif

// Writes zeros into the margins of the maps. There is one work-group for each row of each plane. The host runs this
// kernel once after the shape of the images has changed, because the other kernels write only the values of pixels.
UBS_KERNEL UBS_GROUP(LOSS_GROUP) void loss_margins(UBS_GLOBAL float* maps, int map_pitch, int map_plane, int pitch) {
  int row = (int)ubs_group_at(0), rows = map_plane / map_pitch;
  UBS_GLOBAL float* at = maps + (size_t)ubs_group_at(1) * map_plane + (size_t)row * map_pitch;
  int has_pixels = row >= kSsimRadius && row < rows - kSsimRadius;
  int zeros = has_pixels ? map_pitch - pitch : map_pitch;
  for (int i = ubs_local_id(); i < zeros; i += LOSS_GROUP)
    at[has_pixels && i >= LOSS_MAP_MARGIN ? i + pitch : i] = 0.0f;
}

#define LOSS_TILE_SUMS 4  // numbers per tile and channel in tile_sums; the first kLossQuantities of them are used

// Computes the loss of one tile of one channel. Writes the sums over its pixels to tile_sums. If a gradient is needed,
// also writes the three maps. Without a gradient, map_pitch and map_plane are 0.
UBS_KERNEL UBS_GROUP(LOSS_GROUP) void loss_window(
    UBS_GLOBAL const float* image, UBS_GLOBAL const uchar* target, UBS_GLOBAL const float* target_float, int width,
    int height, int pitch, int rows, int first_channel, int channels, float low, float high,
    UBS_GLOBAL float* maps, int map_pitch, int map_plane, UBS_GLOBAL float* tile_sums,
    UBS_GLOBAL const uchar* mask UBS_CORE_PARAMETERS) {
  UBS_SHARED __attribute__((aligned(64))) real u[LOSS_ROWS * LOSS_COLUMNS];
  UBS_SHARED __attribute__((aligned(64))) real v[LOSS_ROWS * LOSS_COLUMNS];
  UBS_SHARED __attribute__((aligned(64))) real means[4 * LOSS_PART * LOSS_COLUMNS];
  UBS_SHARED real shares[kLossQuantities * LOSS_GROUP];
  LossTile tile = LOSS_THIS_TILE;
  int plane = tile.plane, x0 = tile.x * LOSS_TILE_X, y0 = tile.y * LOSS_TILE_Y;
  LossShape s = {width, height, pitch, rows, first_channel + plane};
  LossPixels all = {image, target, target_float, low, high, mask};
  LossPixels p = channel_pixels(all, s);
  real shift = tile_shift(p, s, x0, y0);

  int columns = tile_columns(x0, pitch);
  load_tile(p, s, x0, y0, halo_vectors(columns), shift, u, v);
  LOSS_BARRIER

  vreal sums[kLossQuantities];
  UBS_UNROLL for (int q = 0; q < kLossQuantities; ++q) sums[q] = V(0.0);
  int vectors = columns / UBS_VW;
  for (int part = 0; part < LOSS_TILE_Y; part += LOSS_PART) {
    sum_columns(u + part * LOSS_COLUMNS, v + part * LOSS_COLUMNS, halo_vectors(columns), means);
    LOSS_BARRIER
    for (int item = ubs_local_id(); item < LOSS_PART * vectors; item += LOSS_GROUP) {
      int in_part = item / vectors, row = part + in_part, column = (item - in_part * vectors) * UBS_VW;
      SsimPoint point = ssim_point(sum_row(means + in_part * LOSS_COLUMNS + column), shift);
      vreal difference = UBS_LOAD(v + (row + kSsimRadius) * LOSS_COLUMNS + column + kSsimRadius);
      vmask inside = pixels_count(p, s, x0 + column, y0 + row);
      LossQuantities here = loss_quantities(difference, point);
      UBS_UNROLL for (int q = 0; q < kLossQuantities; ++q) sums[q] += inside ? here.of[q] : V(0.0);
      if (map_pitch == 0 || x0 + column >= pitch) continue;
      UBS_GLOBAL float* map = maps + (size_t)plane * 3 * map_plane +
                            (size_t)(y0 + row + kSsimRadius) * map_pitch + LOSS_MAP_MARGIN + x0 + column;
      UBS_STORE(inside ? point.mean : V(0.0), map);
      UBS_STORE(inside ? point.square_u : V(0.0), map + map_plane);
      UBS_STORE(inside ? point.square_v : V(0.0), map + 2 * (size_t)map_plane);
    }
  }

  int me = ubs_local_id();
  UBS_UNROLL for (int q = 0; q < kLossQuantities; ++q) shares[q * LOSS_GROUP + me] = sum_lanes(sums[q]);
  LOSS_BARRIER
  size_t index = ((size_t)s.channel * (rows / LOSS_TILE_Y) + tile.y) * tile.across + tile.x;
#if LOSS_GROUP > 1
  // One work-item alone would take as long for these sums as all work-items together take for the rest of the tile.
  for (int i = me; i < kLossQuantities * LOSS_TEAM; i += LOSS_GROUP) {
    UBS_LOCAL real* of_quantity = shares + i / LOSS_TEAM * LOSS_GROUP + i % LOSS_TEAM;
    real sum = R(0.0);
    for (int k = 0; k < LOSS_GROUP; k += LOSS_TEAM) sum += of_quantity[k];
    of_quantity[0] = sum;
  }
  LOSS_BARRIER
#endif
  for (int q = me; q < kLossQuantities; q += LOSS_GROUP) {
    real sum = R(0.0);
    for (int i = 0; i < LOSS_TEAM; ++i) sum += shares[q * LOSS_GROUP + i];
    tile_sums[index * LOSS_TILE_SUMS + q] = sum;
  }
}

// ---- Gradient ----

// Computes the window sums of the three maps along columns for LOSS_PART rows. `sums` receives them in three planes of
// LOSS_PART x LOSS_COLUMNS. Windows at the edge of the image read the zero margins of the maps.
UBS_FN void sum_map_columns(UBS_GLOBAL const float* maps, int map_pitch, int map_plane, int x0, int y0, int pitch,
                            int vectors, UBS_LOCAL real* sums) {
  for (int item = ubs_local_id(); item < LOSS_PART / LOSS_STRIP * vectors; item += LOSS_GROUP) {
    int strip = item / vectors, row = strip * LOSS_STRIP, column = (item - strip * vectors) * UBS_VW;
    if (x0 + column >= pitch + 2 * kSsimRadius) continue;
    UBS_GLOBAL const float* map =
        maps + (size_t)(y0 + row) * map_pitch + LOSS_MAP_MARGIN + x0 - kSsimRadius + column;
    vreal sum0[LOSS_STRIP], sum1[LOSS_STRIP], sum2[LOSS_STRIP];
UBS_UNROLL
    for (int k = 0; k < LOSS_STRIP; ++k) sum0[k] = sum1[k] = sum2[k] = V(0.0);
UBS_UNROLL
    for (int t = 0; t < LOSS_STRIP + 2 * kSsimRadius; ++t) {
      vreal m0 = UBS_LOAD(map + (size_t)t * map_pitch);
      vreal m1 = UBS_LOAD(map + (size_t)t * map_pitch + map_plane);
      vreal m2 = UBS_LOAD(map + (size_t)t * map_pitch + 2 * (size_t)map_plane);
UBS_UNROLL
      for (int k = 0; k < LOSS_STRIP; ++k) {
        if (t < k || t - k >= kSsimTaps) continue;
        vreal w = (vreal)(kWindow[t - k]);
        sum0[k] += w * m0;
        sum1[k] += w * m1;
        sum2[k] += w * m2;
      }
    }
UBS_UNROLL
    for (int k = 0; k < LOSS_STRIP; ++k) {
      UBS_LOCAL real* out = sums + (row + k) * LOSS_COLUMNS + column;
      UBS_STORE(sum0[k], out);
      UBS_STORE(sum1[k], out + LOSS_PART * LOSS_COLUMNS);
      UBS_STORE(sum2[k], out + 2 * LOSS_PART * LOSS_COLUMNS);
    }
  }
}

UBS_KERNEL UBS_GROUP(LOSS_GROUP) void loss_gradient(
    UBS_GLOBAL const float* image, UBS_GLOBAL const uchar* target, UBS_GLOBAL const float* target_float, int width,
    int height, int pitch, int rows, int first_channel, int channels, LossWeights weights,
    UBS_GLOBAL const float* maps, int map_pitch, int map_plane, UBS_GLOBAL float* v_image,
    UBS_GLOBAL const uchar* mask UBS_CORE_PARAMETERS) {
  UBS_SHARED __attribute__((aligned(64))) real sums[3 * LOSS_PART * LOSS_COLUMNS];
  LossTile tile = LOSS_THIS_TILE;
  int plane = tile.plane, x0 = tile.x * LOSS_TILE_X, y0 = tile.y * LOSS_TILE_Y;
  LossShape s = {width, height, pitch, rows, first_channel + plane};
  LossPixels all = {image, target, target_float, -UBS_REAL_MAX, UBS_REAL_MAX, mask};
  LossPixels p = channel_pixels(all, s);
  int columns = tile_columns(x0, pitch);

  int vectors = columns / UBS_VW;
  for (int part = 0; part < LOSS_TILE_Y; part += LOSS_PART) {
    sum_map_columns(maps + (size_t)plane * 3 * map_plane, map_pitch, map_plane, x0, y0 + part, pitch,
                    halo_vectors(columns), sums);
    LOSS_BARRIER
    for (int item = ubs_local_id(); item < LOSS_PART * vectors; item += LOSS_GROUP) {
      int in_part = item / vectors, row = part + in_part, column = (item - in_part * vectors) * UBS_VW;
      if (x0 + column >= pitch) continue;
      UBS_LOCAL const real* sum = sums + in_part * LOSS_COLUMNS + column;
      vreal mean = sum_window(sum), square_u = sum_window(sum + LOSS_PART * LOSS_COLUMNS),
            square_v = sum_window(sum + 2 * LOSS_PART * LOSS_COLUMNS);
      LossPair pair = load_pair(p, s, x0 + column, y0 + row, R(0.0));
      vreal gradient = image_loss_vjp(weights, pair.u, pair.v, mean, square_u, square_v);
      vmask inside = pixels_count(p, s, x0 + column, y0 + row);
      UBS_STORE(inside ? gradient : V(0.0),
                v_image + ((size_t)s.channel * rows + y0 + row) * pitch + x0 + column);
    }
  }
}

// ---- Total ----

typedef struct {
  real sum, lost;  // `lost` is the rounding error of the sum so far (Kahan summation)
} LossSum;

UBS_FN LossSum add_share(LossSum s, real share) {
  real corrected = share - s.lost;
  real next = s.sum + corrected;
  s.lost = (next - s.sum) - corrected;
  s.sum = next;
  return s;
}

// Adds the sums of all tiles, in one work-group. Each channel has 64 shares; share i is the sum of the tiles i, i + 64,
// i + 128, and so on. Afterwards, one work-item per channel and quantity adds the shares.
UBS_KERNEL UBS_GROUP(LOSS_TOTAL_GROUP) void loss_total(
    UBS_GLOBAL const float* tile_sums, int tiles, float pixels, UBS_GLOBAL float* sums, uint sums_offset) {
  UBS_SHARED real shares[3 * kLossQuantities * (LOSS_SHARES + 1)], means[3 * kLossQuantities];  // per channel
  int me = ubs_local_id();
  for (int turn = 0; turn < 3 * LOSS_SHARES / LOSS_TOTAL_GROUP; ++turn) {
    int i = me + turn * LOSS_TOTAL_GROUP;
    int channel = i / LOSS_SHARES, share = i % LOSS_SHARES;
    LossSum sum[kLossQuantities];
    UBS_UNROLL for (int q = 0; q < kLossQuantities; ++q) sum[q].sum = sum[q].lost = R(0.0);
    UBS_GLOBAL const float4* of_channel = (UBS_GLOBAL const float4*)tile_sums + (size_t)channel * tiles;
    // The loop is unrolled, so that four loads are in flight at the same time.
    _Pragma("unroll 4") for (int tile = share; tile < tiles; tile += LOSS_SHARES) {
      float4 tile_sum = of_channel[tile];
      real of_tile[LOSS_TILE_SUMS] = {tile_sum.x, tile_sum.y, tile_sum.z, tile_sum.w};
      UBS_UNROLL for (int q = 0; q < kLossQuantities; ++q) sum[q] = add_share(sum[q], of_tile[q]);
    }
    UBS_LOCAL real* mine = shares + channel * kLossQuantities * (LOSS_SHARES + 1) + share;
    UBS_UNROLL for (int q = 0; q < kLossQuantities; ++q) mine[q * (LOSS_SHARES + 1)] = sum[q].sum;
  }
  UBS_BARRIER();
  if (me < 3 * kLossQuantities) {
    LossSum s = {R(0.0), R(0.0)};
    for (int i = 0; i < LOSS_SHARES; ++i) s = add_share(s, shares[me * (LOSS_SHARES + 1) + i]);
    means[me] = s.sum / pixels;
  }
  UBS_BARRIER();
  if (me > 0) return;
  UBS_GLOBAL float* out = sums + sums_offset;
  real of_image[kLossQuantities];
  for (int q = 0; q < kLossQuantities; ++q)
    of_image[q] = (means[q] + means[kLossQuantities + q] + means[2 * kLossQuantities + q]) / R(3.0);
  out[0] = of_image[kLossL1];
  out[1] = R(1.0) - of_image[kLossDissimilarity];
  for (int c = 0; c < 3; ++c) out[2 + c] = means[c * kLossQuantities + kLossSquare];
  for (int i = 5; i < 8; ++i) out[i] = R(0.0);
  for (int q = kLossSquare + 1; q < kLossQuantities; ++q) out[4 + q - kLossSquare] = of_image[q];
}
