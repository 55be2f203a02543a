// SPDX-License-Identifier: Apache-2.0
// SlotStore holds the gradient slots of a view, one per (tile, splat) pair. It uses a single buffer if the
// device can allocate one of this size. Otherwise it uses several buffers, whose number of slots is a power
// of two; only the last buffer may be smaller.
#pragma once

#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

class SlotStore {
 public:
  // `floats` is the number of floats per slot (stage_sizes::slot_floats()).
  SlotStore(Device& device, unsigned floats) : device_(device), floats_(floats) {}

  // Returns the maximum number of slots on a device if as many buffers are used as the kernels support. The
  // result does not depend on how much memory is already in use.
  static std::uint64_t most(const DeviceInfo& device, unsigned floats);

  // Ensures that the store has at least this number of slots. When it grows, its contents are lost. It then
  // grows by at least half of its size, so that slowly increasing requests do not cause an allocation each
  // time. It grows by less if there is not enough memory, or if it would otherwise need more than one buffer.
  // Throws Error(memory) with the numbers if there is not enough memory for the requested number of slots.
  void reserve(std::uint64_t slots);
  std::uint64_t size() const { return size_; }  // number of slots
  SlotViews view() const;

 private:
  void allocate(std::uint64_t slots);

  std::uint64_t bytes() const { return floats_ * sizeof(float); }  // bytes per slot

  Device& device_;
  unsigned floats_;
  std::uint64_t size_ = 0;
  unsigned bits_ = 0;
  std::vector<Buffer<float>> pieces_;
};

}  // namespace ubs
