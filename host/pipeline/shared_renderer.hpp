// SPDX-License-Identifier: Apache-2.0
// Views of splats that the ranks of a job share, each rank drawing one view at a time: every rank projects
// its splats for all of these views, the rank that draws one gets the records of it and hands their gradient
// back. The splats of a view come in the order of the model, so that image and gradients have the bits that
// one process makes of all of them. Records and gradients travel while the device draws other views: from and
// into the device's memory where the ranks can reach it, else through memory of the host.
#pragma once

#include <memory>
#include <optional>

#include "host/cluster/communicator.hpp"
#include "host/cluster/deal.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs {

// Rows of a buffer on their way to other ranks or from them.
class Freight {
 public:
  // What the buffer holds, once the device has made it; until the next call.
  std::span<const std::byte> out(Communicator& ranks, Device& device, const Buffer<float>& rows,
                                 std::size_t bytes);
  // Where to put what the buffer is to hold; then arrived().
  std::byte* in(Communicator& ranks, Buffer<float>& rows, std::size_t bytes);
  void arrived(Device& device, Buffer<float>& rows) const;

 private:
  std::vector<std::byte> room_;  // where the buffer is out of reach
  std::size_t room_bytes_ = 0;
};

class SharedRenderer {
 public:
  // `drawer` draws this rank's views; it has the same cameras.
  SharedRenderer(Communicator& ranks, Device& device, Stages& stages, Renderer& drawer)
      : ranks_(ranks), device_(device), drawer_(drawer), owner_(device, stages) {}

  void set_cameras(const std::vector<Camera>& cameras) { owner_.set_cameras(cameras); }

  // This rank's part of the view of one rank.
  struct Part {
    DrawnSplats drawn;
    Freight freight;
    std::uint32_t count = 0;
  };
  // Views that the ranks draw at the same time. To be given to the functions below one after the other.
  struct Round {
    SplatView own;
    RenderSettings settings;
    std::vector<std::int64_t> cameras;         // by rank
    std::shared_ptr<std::vector<Part>> parts;  // by rank
    std::vector<std::uint32_t> counts;  // splats of each rank in the view that this rank draws, or empty
    std::unique_ptr<Exchange> on_the_way;
  };

  // Projects, and sends the records. Rank r draws view cameras[r]; nothing where that is kNoView.
  Round begin(const SplatView& own, std::vector<std::int64_t> cameras, const RenderSettings& settings);
  // Waits for the records, and draws. Nothing where this rank draws none.
  std::optional<ListTotals> forward(Round& round, bool for_backward);
  // After forward() and, on the ranks that draw, the first half of backward().
  void send_gradients(Round& round);
  // Waits for the gradients.
  void receive_gradients(Round& round);
  // With the gradient of rank r's view: for the second half of backward(), or for learn().
  Renderer& gradient_of(const Round& round, std::size_t rank);
  Renderer& owner() { return owner_; }

  std::uint64_t bytes_sent() const { return sent_; }  // to other ranks

 private:
  std::size_t own_rank() const { return static_cast<std::size_t>(ranks_.rank()); }
  std::unique_ptr<Exchange> start(const Pieces& pieces);
  std::shared_ptr<std::vector<Part>> unused_parts();
  std::size_t own_bytes_at(const Round& round) const;

  Communicator& ranks_;
  Device& device_;
  Renderer& drawer_;         // of whole views
  Renderer owner_;           // of this rank's splats, as far as records
  Buffer<float> gradients_;  // of the view that this rank has drawn, of all ranks' splats
  Freight gradient_freight_;
  std::vector<std::shared_ptr<std::vector<Part>>> parts_;  // of all rounds that were under way at a time
  std::uint64_t sent_ = 0;
};

}  // namespace ubs
