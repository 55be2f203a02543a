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
#define UBS_CQ (UBS_C > 0 ? UBS_C : 1)  // array extent: arrays of length zero are not allowed

// Meaning of the query dimensions, in order: view direction (3), time (1), further values.
#define UBS_HAS_DIRECTION (UBS_C >= 3)
#define UBS_FIRST_VALUE (UBS_HAS_DIRECTION ? 3 : 0)  // query dims from here on come from the camera

// ---- Parameters: row k of splat i is params[k * stride + i]; rows in the order of the file ----
#define UBS_P_XYZ 0
#define UBS_P_RGB 3  // or spherical harmonics: the three constant terms, then the others by channel, or the lobes
#define UBS_P_OPACITY (UBS_P_RGB + (UBS_COLOUR ? 3 * UBS_SH_COUNT : 3) + 6 * UBS_LOBES)
#define UBS_P_BETA (UBS_P_OPACITY + 1)                           // of the spatial kernel
#define UBS_P_QUERY_BETA (UBS_P_BETA + (UBS_HAS_SPATIAL_BETA ? 1 : 0))
#define UBS_P_MEAN (UBS_P_QUERY_BETA + (UBS_HAS_QUERY_BETA ? UBS_C : 0))
#define UBS_P_SCALE (UBS_P_MEAN + UBS_C)
#define UBS_P_L (UBS_P_SCALE + UBS_N)  // or the quaternion
#define UBS_PARAMS (UBS_P_L + (UBS_ROT_MODE == UBS_ROT_QUATERNION ? 4 : UBS_N * (UBS_N - 1) / 2))
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
  X(0, UBS_P_XYZ, UBS_P_RGB, row) X(1, UBS_P_RGB, UBS_P_RGB + 3, row)                                    \
  X(2, UBS_P_RGB + 3, UBS_P_OPACITY, row) X(3, UBS_P_OPACITY, UBS_P_BETA, row)                           \
  X(4, UBS_P_BETA, UBS_P_MEAN, row) X(5, UBS_P_MEAN, UBS_P_SCALE, row)                                   \
  X(6, UBS_P_SCALE, UBS_P_L, row) X(7, UBS_P_L, UBS_PARAMS, row)
#define UBS_LESS_FROZEN(g, first, last, row) \
  - ((UBS_FROZEN >> (g)&1) && (row) > (first) ? ((row) < (last) ? (row) - (first) : (last) - (first)) : 0)
// Row of gradients and moments of a parameter row.
#define UBS_TRAINED_ROW(row) ((row) UBS_GROUPS(UBS_LESS_FROZEN, row))
#define UBS_TRAINED_ROWS UBS_TRAINED_ROW(UBS_PARAMS)
#define UBS_ROW_FROZEN(row) (UBS_TRAINED_ROW((row) + 1) == UBS_TRAINED_ROW(row))

// ---- Camera record: one row of UBS_CAMERA_STRIDE reals a view ----
#define UBS_CAM_ROTATION 0      // world -> camera, row-major 3 x 3
#define UBS_CAM_CENTRE 9        // camera position in the world
#define UBS_CAM_FOCAL 12        // fx, fy [px]
#define UBS_CAM_PRINCIPAL 14    // cx, cy [px]
#define UBS_CAM_SIZE 16         // width, height [px]
#define UBS_CAM_QUERY 18        // time, then further query values
#define UBS_CAM_QUERY_MAX 8
#define UBS_CAMERA_STRIDE 32

// ---- Projected splat, one record of 16 reals (64 bytes: one cache line) a splat ----
// The conic is kept as its factor: r = (L00 dx + L01 dy)^2 + (L11 dy)^2, never negative.
#define UBS_S_X 0        // mean [px]
#define UBS_S_Y 1
#define UBS_S_L00 2
#define UBS_S_L01 3
#define UBS_S_L11 4
#define UBS_S_OPACITY 5  // conditioned opacity
#define UBS_S_BETA 6     // exponent of the kernel, 4 exp(b_x)
#define UBS_S_R 7
#define UBS_S_G 8
#define UBS_S_B 9
#define UBS_S_HX 10      // half extents of the footprint [px]
#define UBS_S_HY 11
#define UBS_S_DEPTH 12   // z of the conditional mean in the camera frame
#define UBS_S_REACH 13   // with UBS_OPACITY_EXTENTS: r beyond which no alpha counts; else not written
#define UBS_SPLAT_STRIDE 16

// ---- Gradient of a projected splat: one slot of 16 reals an intersection; summed per splat ----
#define UBS_G_X 0        // dL/d mean [1/px]
#define UBS_G_Y 1
#define UBS_G_W00 2      // dL/d ellipse in its own coordinates (EllipseVjp of math/ellipse.h)
#define UBS_G_W01 3
#define UBS_G_W11 4
#define UBS_G_OPACITY 5
#define UBS_G_BETA 6
#define UBS_G_R 7
#define UBS_G_G 8
#define UBS_G_B 9
#define UBS_G_DEPTH 10   // with UBS_DEPTH_GRAD; else not read
#define UBS_GRAD_STRIDE 16
#ifndef UBS_DEPTH_GRAD
#define UBS_DEPTH_GRAD 0
#endif

// ---- Gradient of a camera ----
#define UBS_CG_TURN 0       // R -> exp([w]) R about the camera's centre, w along its axes [1/rad]
#define UBS_CG_SHIFT 3      // p_camera -> p_camera + u
#define UBS_CG_FOCAL 6
#define UBS_CG_PRINCIPAL 8
#define UBS_CG_QUERY 10     // time, then further query values, as in the camera's record
#define UBS_CAMERA_GRADS 15

// ---- Tiles ----
#define UBS_TILE 16
// Depth key of a splat that is not drawn in this view; drawn splats have keys of positive floats.
#define UBS_KEY_CULLED 0xffffffffu
// In the place of a partner's record (MeasureWeights): the splat stays as it is; it is taken away.
#define UBS_PARTNER_SAME 0xfffffffeu
#define UBS_PARTNER_NONE 0xffffffffu

// Images are planar (channel, row, column); the row pitch and the number of rows are the size
// rounded up to whole tiles. Elements outside width x height are undefined.
