// SPDX-License-Identifier: Apache-2.0
// What a rendered view consists of, counted on the host from the lists and block masks of the device.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs::bench {

struct WorkCounts {
  ParameterLayout layout{6};         // N and form of the model
  std::uint64_t splats = 0;          // in the model
  std::uint64_t visible = 0;         // drawn
  std::uint64_t intersections = 0;   // (tile, splat) pairs
  std::uint64_t active_pairs = 0;    // of them, those that contribute: mask not 0
  std::uint64_t blocks = 0;          // (4x4 block, splat) pairs that are composited
  std::uint64_t blended = 0;         // (pixel, splat) pairs that are composited
  std::uint64_t object_pixels = 0;   // pixels with more than three of them
  std::uint64_t object_blended = 0;  // pairs on these
  std::uint64_t pixels = 0;
  // How evenly tiles are loaded: a device that gives a tile to one block waits for the longest list.
  std::uint64_t tiles = 0, longest_list = 0;
  std::uint64_t long_pairs = 0;  // intersections in tiles whose list is longer than four times the mean

  RasterKind lists = RasterKind::cpu;  // the kernels that made them

  double mean_list() const;
  double blended_per_pixel() const;
  double blended_per_object_pixel() const;
  // Share of the 16 lanes of a block that a composited splat uses.
  double lane_utilisation() const;
  // Lanes of blocks a composited pair.
  double block_lanes_per_blended() const;
};

// After a forward pass whose arguments these are. Repeats blending in float on all cores (about 0.1 s for an
// 800x800 view of 300K splats).
WorkCounts count_work(Device& device, const ParameterLayout& layout, std::uint64_t splats,
                      std::uint64_t visible, std::uint64_t intersections, const RasterForward& work,
                      float alpha_min = 0);

}  // namespace ubs::bench
