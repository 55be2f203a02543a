// SPDX-License-Identifier: Apache-2.0
// Views of splats that the ranks of a job share, each rank drawing one view at a time: every rank projects
// its splats for all of these views, the rank that draws one gets the records of it and hands their gradient
// back. The splats of a view come in the order of the model, so that image and gradients have the bits that
// one process makes of all of them.
#pragma once

#include <optional>

#include "host/cluster/communicator.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs {

class SharedRenderer {
 public:
  // `drawer` draws this rank's views; it has the same cameras.
  SharedRenderer(Communicator& ranks, Device& device, Stages& stages, Renderer& drawer)
      : ranks_(ranks), drawer_(drawer), owner_(device, stages) {}

  void set_cameras(const std::vector<Camera>& cameras) { owner_.set_cameras(cameras); }

  static constexpr std::int64_t kNoView = -1;
  // Rank r draws view cameras[r]. Nothing where that is kNoView for this one.
  std::optional<ListTotals> forward(const SplatView& own, std::span<const std::int64_t> cameras,
                                    const RenderSettings& settings, bool for_backward);
  // After forward() and, on the ranks that draw, the first half of backward().
  void backward();
  // With the gradient of rank r's view: for the second half of backward(), or for learn().
  Renderer& gradient_of(std::size_t rank);
  Renderer& owner() { return owner_; }

  std::uint64_t bytes_sent() const { return sent_; }  // to other ranks

 private:
  std::vector<Bytes> exchange(const Pieces& pieces);

  Communicator& ranks_;
  Renderer& drawer_;  // of whole views
  Renderer owner_;    // of this rank's splats, as far as records

  // Of the views drawn last.
  SplatView own_;
  RenderSettings settings_;
  std::vector<std::int64_t> cameras_;            // by rank
  std::vector<std::vector<std::uint32_t>> ids_;  // this rank's splats in the view of each rank
  std::vector<std::size_t> sizes_;               // values of records from each rank
  std::vector<Bytes> gradients_;                 // by the rank that has drawn
  std::uint64_t sent_ = 0;
};

}  // namespace ubs
