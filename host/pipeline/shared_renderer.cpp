// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/shared_renderer.hpp"

#include <numeric>

namespace ubs {
namespace {

constexpr std::size_t kRowBytes = kSplatStride * sizeof(float);
static_assert(int{kGradStride} == int{kSplatStride});

std::uint32_t sum_of(std::span<const std::uint32_t> counts) {
  return std::reduce(counts.begin(), counts.end());
}

// Returns the address of the buffer, or null if other ranks cannot access it.
std::byte* within_reach(Communicator& ranks, const Buffer<float>& rows) {
  const DeviceAddress address = rows.view().memory->address();
  return ranks.takes_memory(address.kind) ? static_cast<std::byte*>(address.pointer) : nullptr;
}

}  // namespace

std::span<const std::byte> TransferBuffer::out(Communicator& ranks, Device& device, const Buffer<float>& rows,
                                               std::size_t bytes) {
  if (bytes == 0) return {};
  if (const std::byte* const at = within_reach(ranks, rows)) {
    device.finish();
    return {at, bytes};
  }
  if (room_.size() < bytes) room_.resize(bytes);
  const std::span<std::byte> room = std::span(room_).first(bytes);
  device.read(*rows.view().memory, 0, room);
  return room;
}

std::byte* TransferBuffer::in(Communicator& ranks, Buffer<float>& rows, std::size_t bytes) {
  room_bytes_ = 0;
  if (bytes == 0) return nullptr;
  if (std::byte* const at = within_reach(ranks, rows)) return at;
  if (room_.size() < bytes) room_.resize(bytes);
  room_bytes_ = bytes;
  return room_.data();
}

void TransferBuffer::arrived(Device& device, Buffer<float>& rows) const {
  if (room_bytes_ > 0) device.write(*rows.view().memory, 0, std::span(room_).first(room_bytes_));
}

std::unique_ptr<Exchange> SharedRenderer::start(const Pieces& pieces) {
  for (const auto& piece : pieces) sent_ += piece.size();
  return ranks_.start(pieces);
}

std::shared_ptr<std::vector<SharedRenderer::Part>> SharedRenderer::unused_parts() {
  for (const auto& parts : parts_)
    if (parts.use_count() == 1) return parts;
  return parts_.emplace_back(std::make_shared<std::vector<Part>>(static_cast<std::size_t>(ranks_.size())));
}

SharedRenderer::Round SharedRenderer::begin(const SplatView& own, std::vector<std::int64_t> cameras,
                                            const RenderSettings& settings) {
  Round round{.own = own, .settings = settings, .cameras = std::move(cameras), .parts = unused_parts()};
  Pieces pieces(round.cameras.size());
  for (std::size_t r = 0; r < pieces.size(); ++r) {
    Part& part = (*round.parts)[r];
    part.count = 0;
    if (round.cameras[r] == kNoView) continue;
    part.count = owner_.project_only(own, static_cast<std::uint32_t>(round.cameras[r]), settings, part.drawn);
    if (r != own_rank())
      pieces[r] = part.freight.out(ranks_, device_, part.drawn.rows, part.count * kRowBytes);
  }
  round.on_the_way = start(pieces);
  return round;
}

std::optional<ListTotals> SharedRenderer::forward(Round& round, bool for_backward) {
  const std::int64_t camera = round.cameras[own_rank()];
  std::vector<std::byte*> into(round.cameras.size());
  if (camera == kNoView) {
    round.on_the_way->receive(into);
    return {};
  }
  Part& own = (*round.parts)[own_rank()];
  for (const std::uint64_t bytes : round.on_the_way->sizes())
    round.counts.push_back(static_cast<std::uint32_t>(bytes / kRowBytes));
  round.counts[own_rank()] = own.count;
  const std::uint32_t drawn = sum_of(round.counts);
  device_.finish();  // the device may still be using these records for an earlier view
  Buffer<float>& records = drawer_.drawn_records(drawn, for_backward);
  std::byte* at = own.freight.in(ranks_, records, drawn * kRowBytes);
  for (std::size_t r = 0; r < into.size(); ++r) {
    into[r] = at;
    if (at) at += round.counts[r] * kRowBytes;
  }
  round.on_the_way->receive(into);
  own.freight.arrived(device_, records);
  if (own.count > 0)
    device_.copy(*own.drawn.rows.view().memory, 0, *records.view().memory, own_bytes_at(round),
                 own.count * kRowBytes);
  return drawer_.forward_projected(drawn, static_cast<std::uint32_t>(camera), round.settings, for_backward);
}

// Returns the offset of this rank's splats in the view that it renders, in bytes.
std::size_t SharedRenderer::own_bytes_at(const Round& round) const {
  return kRowBytes * sum_of(std::span(round.counts).first(own_rank()));
}

// When this is called, the gradients of the previous round have been received, so gradients_ can be
// overwritten.
void SharedRenderer::send_gradients(Round& round) {
  Pieces pieces(round.cameras.size());
  if (!round.counts.empty()) {
    drawer_.take_v_records(gradients_);
    const Part& own = (*round.parts)[own_rank()];
    if (own.count > 0)
      device_.copy(*gradients_.view().memory, own_bytes_at(round), *own.drawn.rows.view().memory, 0,
                   own.count * kRowBytes);
    std::span<const std::byte> rows =
        gradient_freight_.out(ranks_, device_, gradients_, sum_of(round.counts) * kRowBytes);
    for (std::size_t r = 0; r < pieces.size(); ++r) {
      const std::size_t bytes = round.counts[r] * kRowBytes;
      if (r != own_rank()) pieces[r] = rows.first(bytes);
      rows = rows.subspan(bytes);
    }
  }
  round.on_the_way = start(pieces);
}

void SharedRenderer::receive_gradients(Round& round) {
  std::vector<std::byte*> into(round.cameras.size());
  for (std::size_t r = 0; r < into.size(); ++r) {
    Part& part = (*round.parts)[r];
    if (r != own_rank()) into[r] = part.freight.in(ranks_, part.drawn.rows, part.count * kRowBytes);
  }
  round.on_the_way->receive(into);
  for (std::size_t r = 0; r < into.size(); ++r) {
    Part& part = (*round.parts)[r];
    if (r != own_rank()) part.freight.arrived(device_, part.drawn.rows);
  }
}

Renderer& SharedRenderer::gradient_of(const Round& round, std::size_t rank) {
  owner_.take_gradient(round.own, static_cast<std::uint32_t>(round.cameras[rank]), round.settings,
                       (*round.parts)[rank].drawn);
  return owner_;
}

}  // namespace ubs
