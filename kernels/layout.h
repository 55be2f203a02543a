// SPDX-License-Identifier: Apache-2.0
// Index arithmetic of every buffer that kernels share, and of the same buffers on the host.
#pragma once

#ifndef UBS_OPENCL  // there the sources are concatenated
#include "kernels/variant.h"
#endif

// ---- Compile-time shape of a splat: UBS_N dimensions, UBS_C = N - 3 of them query dimensions ----
#ifndef UBS_N
#define UBS_N 6
#endif
#define UBS_C (UBS_N - 3)

// Meaning of the query dimensions, in order: view direction (3), time (1), further values.
#define UBS_HAS_DIRECTION (UBS_C >= 3)
#define UBS_FIRST_VALUE (UBS_HAS_DIRECTION ? 3 : 0)  // query dims from here on come from the camera

// ---- Parameters: row k of splat i is params[k * stride + i]; rows in the order of the file ----
enum {
  kRowXyz = 0,
  kRowRgb = 3,  // or spherical harmonics: the three constant terms, then the others by channel, or the lobes
  kRowOpacity = kRowRgb + (UBS_COLOUR ? 3 * UBS_SH_COUNT : 3) + 6 * UBS_LOBES,
  kRowBeta = kRowOpacity + 1,  // of the spatial kernel
  kRowQueryBeta = kRowBeta + (kHasSpatialBeta ? 1 : 0),
  kRowMean = kRowQueryBeta + (kHasQueryBeta ? UBS_C : 0),
  kRowScale = kRowMean + UBS_C,
  kRowL = kRowScale + UBS_N,  // or the quaternion
  kRowCount = kRowL + (UBS_ROT_MODE == UBS_ROT_QUATERNION ? 4 : UBS_N * (UBS_N - 1) / 2)
};
// Position of element (i, j), i > j, in the packed strict lower triangle (method.md 1.2).
#define UBS_TRIANGLE(i, j) ((i) * ((i)-1) / 2 + (j))

// ---- Gradients and moments: the rows of the parameters that are learnt, in the same order ----
// Bit g of UBS_FROZEN: group g is not learnt (host/scene/frozen_groups.hpp).
#ifndef UBS_FROZEN
#define UBS_FROZEN 0
#endif
// X(group, its first row, the row behind it, row): the groups by their numbers, which are those of kParameterGroups
// (host/scene/splat_model.hpp). 1 is rgb or sh0, 2 the other spherical harmonics or the lobes, 7 l_triangle or rotation.
#define UBS_GROUPS(X, row)                                                                               \
  X(0, kRowXyz, kRowRgb, row) X(1, kRowRgb, kRowRgb + 3, row)                                    \
  X(2, kRowRgb + 3, kRowOpacity, row) X(3, kRowOpacity, kRowBeta, row)                           \
  X(4, kRowBeta, kRowMean, row) X(5, kRowMean, kRowScale, row)                                   \
  X(6, kRowScale, kRowL, row) X(7, kRowL, kRowCount, row)
#define UBS_LESS_FROZEN(g, first, last, row) \
  - ((UBS_FROZEN >> (g)&1) && (row) > (first) ? ((row) < (last) ? (row) - (first) : (last) - (first)) : 0)
// Row of gradients and moments of a parameter row.
#define UBS_TRAINED_ROW(row) ((row) UBS_GROUPS(UBS_LESS_FROZEN, row))
enum { kTrainedRows = UBS_TRAINED_ROW(kRowCount) };

// ---- Camera record: one row of kCameraStride reals a view ----
enum {
  kCameraRotation = 0,    // world -> camera, row-major 3 x 3
  kCameraCentre = 9,      // camera position in the world
  kCameraFocal = 12,      // fx, fy [px]
  kCameraPrincipal = 14,  // cx, cy [px]
  kCameraSize = 16,       // width, height [px]
  kCameraQuery = 18,      // time, then further query values
  kCameraQueryMax = 8,
  kCameraStride = 32
};

// ---- Projected splat, one record of 16 reals (64 bytes: one cache line) a splat ----
// The conic is kept as its factor: r = (L00 dx + L01 dy)^2 + (L11 dy)^2, never negative.
enum {
  kSplatX, kSplatY,              // mean [px]
  kSplatL00, kSplatL01, kSplatL11,
  kSplatOpacity,                 // conditioned opacity
  kSplatBeta,                    // exponent of the kernel, 4 exp(b_x)
  kSplatR, kSplatG, kSplatB,
  kSplatHx, kSplatHy,            // half extents of the footprint [px]
  kSplatDepth,                   // z of the conditional mean in the camera frame
  kSplatReach,                   // with UBS_OPACITY_EXTENTS: r beyond which no alpha counts; else not written
  kSplatStride = 16
};

// ---- Gradient of a projected splat: one slot an intersection; summed per splat ----
enum {
  kGradX, kGradY,                // dL/d mean [1/px]
  kGradW00, kGradW01, kGradW11,  // dL/d ellipse in its own coordinates (EllipseVjp of math/ellipse.h)
  kGradOpacity, kGradBeta, kGradR, kGradG, kGradB,
  kGradDepth,                    // with UBS_DEPTH_GRAD; else not read
  kGradStride = 16,              // of the sums, and of the slots of CPUs, which are one vector
  kCardSlotStride = 12           // of the slots of cards (kernels/gpu): the three words of 16 bytes that have a value
};
#ifndef UBS_DEPTH_GRAD
#define UBS_DEPTH_GRAD 0
#endif

// ---- Gradient of a camera ----
enum {
  kCameraGradTurn = 0,   // R -> exp([w]) R about the camera's centre, w along its axes [1/rad]
  kCameraGradShift = 3,  // p_camera -> p_camera + u
  kCameraGradFocal = 6,
  kCameraGradPrincipal = 8,
  kCameraGradQuery = 10,  // time, then further query values, as in the camera's record
  kCameraGrads = 15
};

// ---- Tiles ----
enum { kTileSide = 16 };  // [px]
// Entries of a tile's list that a group of the backward rasteriser takes (gpu/list_segments.h); a multiple of 256.
enum { kListSegment = 512 };
// Entries of a part of a long list, which a group of the forward rasteriser takes (gpu/list_parts.h), a multiple of
// kListSegment; lists of more than kLongList entries are long.
enum { kListPart = 1024, kLongList = 2 * kListPart };
// Depth key of a splat that is not drawn in this view; drawn splats have keys of positive floats.
#define UBS_KEY_CULLED 0xffffffffu

// ---- What the draws of one iteration are for (kernels/math/rng.h) ----
// Part of the counter, so that uses never share numbers. The top bits keep them apart from the host's
// initialisation, which shares the seed.
enum { kDrawRelocate = 0x55000001, kDrawGrow, kDrawNoise };

// Images are planar (channel, row, column); the row pitch and the number of rows are the size
// rounded up to whole tiles. Elements outside width x height are undefined.
