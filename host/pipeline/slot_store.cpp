// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/slot_store.hpp"

#include <algorithm>
#include <bit>

#include "host/base/error.hpp"

namespace ubs {
namespace {

constexpr std::uint64_t kMaxSlots = 0xffffffffu;  // slot numbers have 32 bits

std::uint64_t in_one_piece(const DeviceInfo& device, unsigned floats) {
  return std::clamp<std::uint64_t>(device.max_allocation_bytes / (floats * sizeof(float)), 1, kMaxSlots);
}

}  // namespace

std::uint64_t SlotStore::most(const DeviceInfo& device, unsigned floats) {
  const std::uint64_t one = in_one_piece(device, floats);
  return std::min(kMaxSlots, std::max(one, SlotViews::kMaxPieces * std::bit_floor(one)));
}

void SlotStore::reserve(std::uint64_t slots) {
  if (slots <= size_) return;
  const DeviceInfo& info = device_.info();
  const std::uint64_t others = device_.allocated_bytes() - size_ * bytes();
  const std::uint64_t free = info.memory_bytes > others ? (info.memory_bytes - others) / bytes() : 0;
  const std::uint64_t possible = std::min(most(info, floats_), free), one = in_one_piece(info, floats_);
  if (slots > possible)
    fail(ErrorKind::memory,
         "{} gradient slots need {} MiB, but only {} MiB are available on {}: use fewer splats or smaller "
         "images",
         slots, slots * bytes() >> 20, possible * bytes() >> 20, info.name);
  std::uint64_t room = std::max(slots, size_ + size_ / 2);
  if (slots <= one) room = std::min(room, one);
  make_grown(slots, room <= possible ? room : slots, [this](std::uint64_t made) { allocate(made); });
}

void SlotStore::allocate(std::uint64_t slots) {
  const std::uint64_t one = in_one_piece(device_.info(), floats_);
  pieces_.clear();
  size_ = 0;
  bits_ = slots <= one ? 32 : static_cast<unsigned>(std::bit_width(one)) - 1;
  const std::uint64_t each = std::uint64_t{1} << bits_;
  for (std::uint64_t left = slots; left > 0; left -= std::min(left, each))
    pieces_.emplace_back(device_, "gradient slots", std::min(left, each) * floats_);
  size_ = slots;
}

SlotViews SlotStore::view() const {
  SlotViews views{{}, static_cast<unsigned>(pieces_.size()), bits_};
  for (std::size_t i = 0; i < pieces_.size(); ++i) views.pieces[i] = pieces_[i].view();
  return views;
}

}  // namespace ubs
