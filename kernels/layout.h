// SPDX-License-Identifier: Apache-2.0
// layout.h defines the layout of all buffers that kernels share with each other or with the host: names for their rows,
// columns and sizes. The host code includes this header as well.
#pragma once

#ifndef UBS_OPENCL  // for OpenCL, the host concatenates all files of a program
#include "kernels/variant.h"
#endif

// ---- Shape of a splat, fixed at compile time: UBS_N dimensions, of which UBS_C = N - 3 are query dimensions ----
#ifndef UBS_N
#define UBS_N 6
#endif
#define UBS_C (UBS_N - 3)

// The query dimensions are, in this order: view direction (3), time (1), further values.
#define UBS_HAS_DIRECTION (UBS_C >= 3)
// Index of the first query dimension whose value is stored in the camera record.
#define UBS_FIRST_VALUE (UBS_HAS_DIRECTION ? 3 : 0)

// ---- Parameters: row k of splat i is params[k * stride + i]; the rows have the same order as in the model file ----
enum {
  kRowXyz = 0,
  // The rows of the colour. With rgb these are its three values. Otherwise they start with the three constant terms of
  // the spherical harmonics (sh0). After these come either the other terms, channel by channel, or the six fields of
  // the lobes, field by field (lobe_row() of math/colour.h).
  kRowRgb = 3,
  kRowOpacity = kRowRgb + (UBS_COLOUR ? 3 * UBS_SH_COUNT : 3) + 6 * UBS_LOBES,
  kRowBeta = kRowOpacity + 1,  // the raw beta of the spatial kernel
  kRowQueryBeta = kRowBeta + (kHasSpatialBeta ? 1 : 0),
  kRowMean = kRowQueryBeta + (kHasQueryBeta ? UBS_C : 0),
  kRowScale = kRowMean + UBS_C,
  kRowL = kRowScale + UBS_N,  // a triangle of N (N - 1) / 2 values, or a quaternion
  kRowCount = kRowL + (UBS_ROT_MODE == UBS_ROT_QUATERNION ? 4 : UBS_N * (UBS_N - 1) / 2)
};
// If UBS_GAUSSIAN_ARRAYS is 1, the splats are 3D Gaussians whose values are in arrays of the program, with the layout
// of PyTorch and similar packages. `params` and `v_params` are then tables of addresses (GaussianArrays of
// map/arrays.h), and scales and opacities are stored as they are, not as raw parameters. Registers still have the rows
// of this file.
#ifndef UBS_GAUSSIAN_ARRAYS
#define UBS_GAUSSIAN_ARRAYS 0
#endif
// Position of element (i, j), i > j, in the packed strict lower triangle (method.md 1.2).
#define UBS_TRIANGLE(i, j) ((i) * ((i)-1) / 2 + (j))

// ---- Gradients and moments: they have only the rows of the trained parameters, in the same order ----
// If bit g of UBS_FROZEN is set, parameter group g is not trained (host/scene/frozen_groups.hpp).
#ifndef UBS_FROZEN
#define UBS_FROZEN 0
#endif
// X(group, first row, end row, row): calls X for each parameter group, where `end row` is one past the last row of the
// group. The groups are numbered as in kParameterGroups (host/scene/splat_model.hpp). Group 1 is rgb or sh0; group 2
// holds the other spherical harmonics or the lobes; group 7 is l_triangle or the rotation.
#define UBS_GROUPS(X, row)                                                                               \
  X(0, kRowXyz, kRowRgb, row) X(1, kRowRgb, kRowRgb + 3, row)                                    \
  X(2, kRowRgb + 3, kRowOpacity, row) X(3, kRowOpacity, kRowBeta, row)                           \
  X(4, kRowBeta, kRowMean, row) X(5, kRowMean, kRowScale, row)                                   \
  X(6, kRowScale, kRowL, row) X(7, kRowL, kRowCount, row)
#define UBS_LESS_FROZEN(g, first, last, row) \
  - ((UBS_FROZEN >> (g)&1) && (row) > (first) ? ((row) < (last) ? (row) - (first) : (last) - (first)) : 0)
// Index of the row of the gradients and moments that belongs to the parameter row `row`.
#define UBS_TRAINED_ROW(row) ((row) UBS_GROUPS(UBS_LESS_FROZEN, row))
enum { kTrainedRows = UBS_TRAINED_ROW(kRowCount) };

// ---- Camera record: one row of kCameraStride reals per view ----
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

// ---- Projected splat: one record of 16 reals per splat (64 bytes, which is one cache line) ----
// The conic is stored as its triangular factor: r = (L00 dx + L01 dy)^2 + (L11 dy)^2, which is never negative.
enum {
  kSplatX, kSplatY,              // mean [px]
  kSplatL00, kSplatL01, kSplatL11,
  kSplatOpacity,                 // conditioned opacity
  kSplatBeta,                    // exponent of the kernel, 4 exp(b_x)
  kSplatR, kSplatG, kSplatB,
  kSplatHx, kSplatHy,            // half extents of the footprint [px]
  kSplatDepth,                   // z of the conditional mean in the camera frame
  kSplatReach,                   // beyond this r, alpha is too small to contribute; only set with UBS_OPACITY_EXTENTS
  kSplatStride = 16
};

// ---- Gradient of a projected splat: one slot per intersection; the slots of a splat are summed ----
enum {
  kGradX, kGradY,                // dL/d mean [1/px]
  kGradW00, kGradW01, kGradW11,  // dL/d ellipse in its own coordinates (EllipseVjp of math/ellipse.h)
  kGradOpacity, kGradBeta, kGradR, kGradG, kGradB,
  kGradDepth,                    // only read with UBS_DEPTH_GRAD
  kGradStride = 16,              // stride of the sums, and of the slots on CPUs, where a slot is one vector
  kCardSlotStride = 12           // stride of the slots on GPUs (kernels/gpu): the three 16-byte words that hold values
};
#ifndef UBS_DEPTH_GRAD
#define UBS_DEPTH_GRAD 0
#endif

// ---- Gradient of a camera ----
enum {
  // Rotation of the camera about its centre, R -> exp([w]) R, with w in the axes of the camera [1/rad].
  kCameraGradTurn = 0,
  kCameraGradShift = 3,  // translation of the camera frame, p_camera -> p_camera + u
  kCameraGradFocal = 6,
  kCameraGradPrincipal = 8,
  kCameraGradQuery = 10,  // time, then further query values, as in the camera record
  kCameraGrads = 15
};

// ---- Tiles ----
enum { kTileSide = 16 };  // [px]
// Number of list entries that one work-group of the backward rasteriser processes (gpu/list_segments.h); a multiple of
// 256.
enum { kListSegment = 512 };
// A list with more than kLongList entries is long. The forward rasteriser divides long lists into parts of kListPart
// entries, and one work-group processes one part (gpu/list_parts.h). kListPart is a multiple of kListSegment.
enum { kListPart = 1024, kLongList = 2 * kListPart };
// Depth key of a splat that is not visible in this view. The key of a visible splat is the bit pattern of its depth, a
// positive float.
#define UBS_KEY_CULLED 0xffffffffu

// ---- Purposes of the random numbers of one iteration (kernels/math/rng.h) ----
// The purpose is part of the counter of the generator, so that different uses never share random numbers. The upper
// bits differ from those of the host's initialisation, which uses the same seed.
enum { kDrawRelocate = 0x55000001, kDrawGrow, kDrawNoise, kDrawRelocatedPlace, kDrawGrownPlace };

// The value that replaces the index of a source for a splat that is not a copy.
#define UBS_NO_SOURCE 0xffffffffu

// Images are planar (channel, row, column). The row pitch and the number of rows are the size of the image rounded up
// to whole tiles. Elements outside width x height are undefined.
