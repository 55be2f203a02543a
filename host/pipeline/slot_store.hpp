// SPDX-License-Identifier: Apache-2.0
// SlotStore holds the gradient slots of a view, one per (tile, splat) pair. It uses a single buffer if the
// device can allocate one of this size, and otherwise several buffers of 2^bits slots.
#pragma once

#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

class SlotStore {
 public:
  // `floats` is the size of a slot (slot_floats()).
  SlotStore(Device& device, unsigned floats) : device_(device), floats_(floats) {}

  // Returns the maximum number of slots on a device with as many buffers as the kernels support. Memory that
  // is already in use is not considered.
  static std::uint64_t most(const DeviceInfo& device, unsigned floats);

  // Makes room for this number of slots. When the store grows, its contents are lost. It grows by at least
  // half if there is memory for that, as Buffer::reserve does. Throws Error(memory) with the numbers if the
  // memory is not even sufficient for the requested size.
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
