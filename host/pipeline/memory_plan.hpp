// SPDX-License-Identifier: Apache-2.0
// Device memory of training and of rendering, counted from the buffers that the pipeline and the OpenCL
// stages allocate: what a splat, a pixel and a (tile, splat) intersection cost, and the total of a run before
// it starts. tests/bench/bench_device_test.cpp holds it against what is really allocated.
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
  ModelVariant variant = {};        // fixes with `dim` the parameter rows
  std::vector<Group> groups = {};   // of a model that is drawn, in place of `dim`; they add up to `splats`
  int trained_rows = -1;            // rows of gradients and moments; -1: those of all parameters
  std::size_t splats = 0;           // training: the most there will be
  int width = 0, height = 0;        // of the largest view
  std::uint64_t intersections = 0;  // (tile, splat) pairs of the view with most of them
  std::size_t views = 0;            // cameras on the device
  std::uint64_t target_bytes = 0;   // ground-truth images kept on the device, 3 bytes a pixel, 4 with a mask
  std::size_t loss_rows = 0;        // views between two readings of the loss (batch * log_every)
  bool learns_sky = false;          // TrainSettings::background
  std::size_t appearances = 0;      // training images whose exposure and white balance are learnt
  bool training = true;             // false: forward only
  bool refinement = true;           // training with relocation and growth
  bool depth = false;
  RasterKind raster = RasterKind::cpu;
  bool sorts_by_copying = false;  // of DeviceInfo
  unsigned compute_units = 1;     // of the device: bounds the chunks of sorting on CPUs
};

enum class MemoryUnit { splat, pixel, intersection, view, fixed };
std::string_view to_string(MemoryUnit unit);

struct MemoryItem {
  std::string label;  // of the buffer, or what the scratch is for
  MemoryUnit unit;
  double each = 0;  // bytes a unit; splats and pixels padded as they are allocated are not counted here
  std::uint64_t bytes = 0;
  bool splits = false;  // into several allocations, where one is too small
};

struct MemoryPlan {
  std::vector<MemoryItem> items;
  std::uint64_t total() const;
  const MemoryItem& largest()
      const;  // of the items that must fit into one allocation: not images, nor what splits
  double each(MemoryUnit unit) const;  // bytes a splat, pixel, ...
};

MemoryPlan plan_memory(const MemoryQuestion& question);

// "predicted 61.2 MiB (744 B a splat, 68 B a pixel, 74 B an intersection)".
std::string summary(const MemoryPlan& plan);

// Returns why a training or rendering with this plan does not fit the device, with the numbers: its largest
// item, its gradient slots, or its sum exceeds a limit. Returns an empty text if it fits.
std::string memory_shortage(const MemoryPlan& plan, const DeviceInfo& device);
// Throws Error(memory) with the text of memory_shortage() unless the plan fits the device.
void check_fits(const MemoryPlan& plan, const DeviceInfo& device);

}  // namespace ubs
