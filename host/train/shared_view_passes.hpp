// SPDX-License-Identifier: Apache-2.0
// SharedViewPasses divides the views of a step among the ranks of an MPI job (docs/cluster.md). Every rank
// projects its splats for all views of the step. The rank that renders a view receives the records of the
// projected splats from all ranks and sends their gradients back.
#pragma once

#include <memory>

#include "host/cluster/communicator.hpp"
#include "host/cluster/view_assignment.hpp"
#include "host/pipeline/shared_renderer.hpp"
#include "host/train/view_passes.hpp"

namespace ubs {

class SharedViewPasses final : public ViewPasses {
 public:
  SharedViewPasses(Communicator& ranks, Device& device, Stages& stages, TrainingViews& views,
                   TrainedSplats& splats, const RenderSettings& settings)
      : ViewPasses(device, stages, views, splats, settings),
        ranks_(ranks),
        shared_(ranks, device, stages, renderer_),
        deal_(views.batch(), ranks.size()) {}

  // Sets how many views of a batch each rank renders. Without this call, these numbers differ by at most one.
  // Must be called before the first step.
  void assign_views(std::vector<std::uint64_t> by_rank) { deal_ = ViewAssignment(std::move(by_rank)); }
  const ViewAssignment& deal() const { return deal_; }
  // Returns the number of bytes that this rank has sent.
  std::uint64_t bytes_sent() const { return shared_.bytes_sent(); }
  // Renders a training view on the device of every rank and compares the images. On the first rank, returns
  // for each rank the largest absolute difference of its image from the image of the first rank. Colours are
  // from 0 to 1.
  std::vector<double> picture_differences(std::uint32_t view);

  void set_cameras(const std::vector<Camera>& cameras) override;
  void draw(std::uint32_t camera) override;
  int run(const StepViews& step) override;
  void upload_first(int iteration) override;
  Renderer& learning_renderer() override { return shared_.owner(); }
  void merge(BufferView<float> rows, std::size_t width) const override;
  void agree(std::span<bool> decisions, BufferView<std::uint32_t> sentinel, int iteration) const override;

 private:
  Metrics evaluate_test_views(ImageMetrics* more, Appearance fit) override;
  Communicator& ranks() override { return ranks_; }
  // Renders cameras[r] on rank r, or nothing if it is kNoView.
  void draw_round(std::vector<std::int64_t> cameras);

  Communicator& ranks_;
  SharedRenderer shared_;
  ViewAssignment deal_;
};

// Returns the ViewPasses of this rank. This is a SharedViewPasses or, if there is only one rank, an object of
// the base class, which renders all views.
std::unique_ptr<ViewPasses> make_view_passes(Communicator& ranks, Device& device, Stages& stages,
                                             TrainingViews& views, TrainedSplats& splats,
                                             const RenderSettings& settings);

}  // namespace ubs
