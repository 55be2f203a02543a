// SPDX-License-Identifier: Apache-2.0
// plan_memory() computes the device memory of a training or of rendering before it starts, from the sizes of
// the buffers that the pipeline and the OpenCL stages allocate: the bytes per splat, per pixel and per (tile,
// splat) intersection, and the total. tests/bench/bench_device_test.cpp compares the result with the memory
// that is actually allocated.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

struct MemoryQuestion {
  struct Group {
    int dim = 6;
    std::size_t splats = 0;
  };
  int dim = 6;
  ModelVariant variant = {};       // determines the parameter rows together with `dim`
  std::vector<Group> groups = {};  // for rendering a model, instead of `dim`; their splats add up to `splats`
  int trained_rows = -1;           // rows of gradients and moments; -1: those of all parameters
  std::size_t splats = 0;          // for training: the maximum during the run
  int width = 0, height = 0;       // size of the largest view
  std::uint64_t intersections = 0;  // (tile, splat) pairs: maximum over the views
  std::size_t views = 0;            // number of cameras on the device
  std::uint64_t target_bytes = 0;   // ground-truth images on the device, 3 bytes per pixel, or 4 with a mask
  std::size_t loss_rows = 0;        // views between two readings of the loss (batch * log_every)
  bool learns_sky = false;          // TrainSettings::background
  std::size_t appearances = 0;      // training images whose exposure and white balance are learnt
  bool training = true;             // false: forward only
  bool refinement = true;           // training with relocation and growth
  bool depth = false;
  RasterKind raster = RasterKind::cpu;
  bool sorts_by_copying = false;  // as in DeviceInfo
  unsigned compute_units = 1;     // of the device; limits the number of chunks in sorting on CPUs
};

enum class MemoryUnit { splat, pixel, intersection, view, fixed };
std::string_view to_string(MemoryUnit unit);

struct MemoryItem {
  std::string label;  // label of the buffer, or the purpose of the scratch memory
  MemoryUnit unit;
  double each = 0;  // bytes per unit, without the padding of splats and pixels
  std::uint64_t bytes = 0;
  bool splits = false;  // can be divided into several allocations if one is too small
};

struct MemoryPlan {
  std::vector<MemoryItem> items;
  std::uint64_t total() const;
  // Returns the largest of the items that must fit into one allocation. Images and items that can be divided
  // are not considered.
  const MemoryItem& largest() const;
  double each(MemoryUnit unit) const;  // bytes per splat, pixel, ...
};

MemoryPlan plan_memory(const MemoryQuestion& question);

// Returns a text such as "predicted 61.2 MiB (744 B per splat, 68 B per pixel, 74 B per intersection)".
std::string summary(const MemoryPlan& plan);

// Returns the reason, with numbers, why a training or rendering with this plan does not fit on the device:
// its largest item, its gradient slots or its total exceeds a limit. Returns an empty text if it fits.
std::string memory_shortage(const MemoryPlan& plan, const DeviceInfo& device);
// Throws Error(memory) with the text of memory_shortage() unless the plan fits the device.
void check_fits(const MemoryPlan& plan, const DeviceInfo& device);

}  // namespace ubs
