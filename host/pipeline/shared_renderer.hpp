// SPDX-License-Identifier: Apache-2.0
// SharedRenderer renders views of a model whose splats are distributed over the ranks of an MPI job. At any
// time each rank renders at most one view. Every rank projects its own splats for the views of all ranks. The
// rank that renders a view receives the records from all ranks and sends their gradients back. The splats of
// a view are in the order of the model, so image and gradients are bit-identical to those of one process that
// has all splats. Records and gradients are transferred while the device renders other views: directly from
// and to device memory if the ranks can access it, and otherwise through host memory.
#pragma once

#include <memory>
#include <optional>

#include "host/cluster/communicator.hpp"
#include "host/cluster/view_assignment.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs {

// TransferBuffer is a transfer buffer for rows that are sent to other ranks or received from them.
class TransferBuffer {
 public:
  // Waits until the device has computed the rows, and returns their bytes. They are valid until the next
  // call.
  std::span<const std::byte> out(Communicator& ranks, Device& device, const Buffer<float>& rows,
                                 std::size_t bytes);
  // Returns the address at which rows must be received: the device buffer `rows`, or host memory if other
  // ranks cannot access that buffer. After the transfer, the caller must call arrived(), which copies the
  // rows from host memory to the device if necessary.
  std::byte* in(Communicator& ranks, Buffer<float>& rows, std::size_t bytes);
  void arrived(Device& device, Buffer<float>& rows) const;

 private:
  std::vector<std::byte> room_;  // used if other ranks cannot access the buffer
  std::size_t room_bytes_ = 0;
};

class SharedRenderer {
 public:
  // `drawer` renders the complete views of this rank. It must have the same cameras as those passed to
  // set_cameras().
  SharedRenderer(Communicator& ranks, Device& device, Stages& stages, Renderer& drawer)
      : ranks_(ranks), device_(device), drawer_(drawer), owner_(device, stages) {}

  void set_cameras(const std::vector<Camera>& cameras) { owner_.set_cameras(cameras); }

  // Part holds the splats that this rank contributes to the view of one of the ranks.
  struct Part {
    VisibleSplats drawn;
    TransferBuffer freight;
    std::uint32_t count = 0;
  };
  // Round describes the views that the ranks render at the same time, one per rank. For each Round, the
  // functions below must be called in the order of their declaration.
  struct Round {
    SplatView own;  // the splats of this rank
    RenderSettings settings;
    std::vector<std::int64_t> cameras;         // index of each rank's camera, or kNoView
    std::shared_ptr<std::vector<Part>> parts;  // one Part for the view of each rank
    // Number of visible splats of each rank in the view that this rank renders. Empty if it renders none.
    std::vector<std::uint32_t> counts;
    std::unique_ptr<Exchange> on_the_way;  // the transfer of records or gradients that is in progress
  };

  // Projects the splats and starts to send the records. Rank r renders the view cameras[r], or none if that
  // is kNoView.
  Round begin(const SplatView& own, std::vector<std::int64_t> cameras, const RenderSettings& settings);
  // Waits for the records and renders. Returns nothing if this rank renders no view.
  std::optional<ListTotals> forward(Round& round, bool for_backward);
  // Starts to send the gradients of the records. Must be called after forward() and, on ranks that render a
  // view, after Renderer::backward_to_records() of `drawer`.
  void send_gradients(Round& round);
  // Waits until the gradients of this rank's splats have been received from all ranks that render a view.
  void receive_gradients(Round& round);
  // Returns a renderer that contains the gradient of this rank's records for the view of `rank`. The caller
  // can then call backward_from_records() or learn() of this renderer.
  Renderer& gradient_of(const Round& round, std::size_t rank);
  Renderer& owner() { return owner_; }

  std::uint64_t bytes_sent() const { return sent_; }  // number of bytes sent to other ranks

 private:
  std::size_t own_rank() const { return static_cast<std::size_t>(ranks_.rank()); }
  std::unique_ptr<Exchange> start(const Pieces& pieces);
  std::shared_ptr<std::vector<Part>> unused_parts();
  std::size_t own_bytes_at(const Round& round) const;

  Communicator& ranks_;
  Device& device_;
  Renderer& drawer_;         // renders whole views
  Renderer owner_;           // projects this rank's splats to records
  Buffer<float> gradients_;  // of all splats in the view that this rank has rendered
  TransferBuffer gradient_freight_;
  // Parts that later rounds reuse. Each round in progress uses one entry, so the number of entries is the
  // maximum number of rounds that were in progress at the same time.
  std::vector<std::shared_ptr<std::vector<Part>>> parts_;
  std::uint64_t sent_ = 0;
};

}  // namespace ubs
