// SPDX-License-Identifier: Apache-2.0
// plan_memory() computes the device memory of a training run or of rendering before it starts. It adds up the
// sizes of the buffers that the pipeline and the OpenCL stages allocate. The result contains the bytes per
// splat, per pixel and per (tile, splat) intersection, and the total. tests/bench/bench_device_test.cpp
// compares the result with the memory that is actually allocated.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

// MemoryQuestion contains the inputs of the estimate.
struct MemoryQuestion {
  struct Group {
    int dim = 6;
    std::size_t splats = 0;
  };
  int dim = 6;
  ModelVariant variant = {};        // determines the parameter rows together with `dim`
  std::vector<Group> groups = {};   // groups of a model for rendering, used instead of `dim`
  int trained_rows = -1;            // number of parameter rows with gradients and moments; -1: all rows
  std::size_t splats = 0;           // in all groups; for training, the maximum during the run
  int width = 0, height = 0;        // size of the largest view
  std::uint64_t intersections = 0;  // (tile, splat) pairs: maximum over the views
  std::size_t views = 0;            // number of cameras on the device
  std::uint64_t target_bytes = 0;   // size of the target images on the device
  std::size_t loss_rows = 0;        // number of views between two downloads of the loss
  bool learns_sky = false;          // whether the background is trained, as a colour or a sky
  std::size_t appearances = 0;      // number of images whose exposure and white balance are trained
  bool training = true;             // false: only rendering
  bool refinement = true;           // whether splats are relocated and added during training
  bool depth = false;               // whether depth is rendered
  RasterKind raster = RasterKind::cpu;
  bool sorts_by_copying = false;  // DeviceInfo::sorts_by_copying
  unsigned compute_units = 1;     // DeviceInfo::compute_units; CPUs divide a sort into a few chunks per unit
};

enum class MemoryUnit { splat, pixel, intersection, view, fixed };
std::string_view to_string(MemoryUnit unit);

// MemoryItem is the memory of one buffer, or of several buffers with the same purpose.
struct MemoryItem {
  std::string label;  // label of the buffer, or the purpose of the scratch memory
  MemoryUnit unit;
  double each = 0;  // bytes per unit, without the padding of splats and pixels
  std::uint64_t bytes = 0;
  bool splits = false;  // whether the buffer can be divided into several allocations
};

struct MemoryPlan {
  std::vector<MemoryItem> items;
  std::uint64_t total() const;
  // Returns the largest of the items that must fit into one allocation. Items per view and items that can be
  // divided are not considered.
  const MemoryItem& largest() const;
  double each(MemoryUnit unit) const;  // sum of `each` over the items of this unit
};

MemoryPlan plan_memory(const MemoryQuestion& question);

// Returns a string such as "predicted 61.2 MiB (744 B per splat, 68 B per pixel, 74 B per intersection)".
std::string summary(const MemoryPlan& plan);

// Returns the reason, with numbers, why training or rendering with this plan does not fit on the device: its
// largest item, its gradient slots or its total exceeds a limit. Returns an empty string if it fits.
std::string memory_shortage(const MemoryPlan& plan, const DeviceInfo& device);
// Throws Error(memory) with the text of memory_shortage() unless the plan fits the device.
void check_fits(const MemoryPlan& plan, const DeviceInfo& device);

}  // namespace ubs
