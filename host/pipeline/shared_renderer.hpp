// SPDX-License-Identifier: Apache-2.0
// Views of splats that the ranks of a job share, each rank drawing one view at a time: every rank projects
// its splats for all of these views, the rank that draws one gets the records of it and hands their gradient
// back. The splats of a view come in the order of the model, so that image and gradients have the bits that
// one process makes of all of them. Records and gradients travel while the device draws other views.
#pragma once

#include <memory>
#include <optional>

#include "host/cluster/communicator.hpp"
#include "host/cluster/deal.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs {

class SharedRenderer {
 public:
  // `drawer` draws this rank's views; it has the same cameras.
  SharedRenderer(Communicator& ranks, Device& device, Stages& stages, Renderer& drawer)
      : ranks_(ranks), drawer_(drawer), owner_(device, stages) {}

  void set_cameras(const std::vector<Camera>& cameras) { owner_.set_cameras(cameras); }

  // Views that the ranks draw at the same time. To be given to the functions below one after the other.
  struct Round {
    SplatView own;
    RenderSettings settings;
    std::vector<std::int64_t> cameras;            // by rank
    std::vector<std::vector<std::uint32_t>> ids;  // this rank's splats in the view of each rank
    std::vector<std::vector<float>> records;      // of these
    std::vector<std::size_t> sizes;               // values of records from each rank
    std::vector<float> v_records;                 // of the view that this rank has drawn
    std::span<const float> own_gradient;          // the part of it that is of its own splats
    std::unique_ptr<Exchange> on_the_way;
    std::vector<Bytes> come;  // by the rank that it is from
  };

  // Projects, and sends the records. Rank r draws view cameras[r]; nothing where that is kNoView.
  Round begin(const SplatView& own, std::vector<std::int64_t> cameras, const RenderSettings& settings);
  // Waits for the records, and draws. Nothing where this rank draws none.
  std::optional<ListTotals> forward(Round& round, bool for_backward);
  // After forward() and, on the ranks that draw, the first half of backward().
  void send_gradients(Round& round);
  // Waits for the gradients.
  void receive_gradients(Round& round) const { round.come = round.on_the_way->finish(); }
  // With the gradient of rank r's view: for the second half of backward(), or for learn().
  Renderer& gradient_of(const Round& round, std::size_t rank);
  Renderer& owner() { return owner_; }

  std::uint64_t bytes_sent() const { return sent_; }  // to other ranks

 private:
  std::size_t own_rank() const { return static_cast<std::size_t>(ranks_.rank()); }
  std::unique_ptr<Exchange> start(const Pieces& pieces);

  Communicator& ranks_;
  Renderer& drawer_;  // of whole views
  Renderer owner_;    // of this rank's splats, as far as records
  std::uint64_t sent_ = 0;
};

}  // namespace ubs
