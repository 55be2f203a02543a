// SPDX-License-Identifier: Apache-2.0
// Room for the gradient slots of a view, one a (tile, splat) pair: one buffer while an allocation of the
// device holds it, else pieces of 2^bits slots.
#pragma once

#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

class SlotStore {
 public:
  // floats: of a slot (slot_floats()).
  SlotStore(Device& device, unsigned floats) : device_(device), floats_(floats) {}

  // Slots that a device can have at most, in as many pieces as kernels take; memory in use is not looked at.
  static std::uint64_t most(const DeviceInfo& device, unsigned floats);

  // Content is lost when it grows; grows by at least half where there is memory for that, as Buffer::reserve
  // does. Throws Error(memory) with the numbers where there is not even memory for what is asked for.
  void reserve(std::uint64_t slots);
  std::uint64_t size() const { return size_; }  // slots
  SlotViews view() const;

 private:
  void allocate(std::uint64_t slots);

  std::uint64_t bytes() const { return floats_ * sizeof(float); }  // of a slot

  Device& device_;
  unsigned floats_;
  std::uint64_t size_ = 0;
  unsigned bits_ = 0;
  std::vector<Buffer<float>> pieces_;
};

}  // namespace ubs
