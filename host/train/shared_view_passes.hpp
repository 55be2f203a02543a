// SPDX-License-Identifier: Apache-2.0
// SharedViewPasses divides the views of a step among the ranks of a job (docs/cluster.md). Every rank
// projects its splats for all views, and the rank that draws a view gets the records of it and hands their
// gradient back.
#pragma once

#include "host/cluster/communicator.hpp"
#include "host/cluster/deal.hpp"
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

  // Before the first step: how many views of a batch each rank draws, in place of as many.
  void deal_views(std::vector<std::uint64_t> by_rank) { deal_ = Deal(std::move(by_rank)); }
  const Deal& deal() const { return deal_; }
  std::uint64_t bytes_sent() const { return shared_.bytes_sent(); }  // of this rank
  // Compares the picture of a training view as each rank draws it on its device. Returns by rank the largest
  // difference from the first rank's [of white].
  std::vector<double> picture_differences(std::uint32_t view);

  void set_cameras(const std::vector<Camera>& cameras) override;
  void draw(std::uint32_t camera) override;
  int run(const StepViews& step) override;
  void upload_first(int iteration) override;
  Renderer& learning_renderer() override { return shared_.owner(); }
  void merge(BufferView<float> rows, std::size_t width) const override;
  Metrics evaluate_test(ImageMetrics* more, Appearance fit) override;

 private:
  // Each rank draws one view, or none (kNoView).
  void draw_round(std::vector<std::int64_t> cameras);

  Communicator& ranks_;
  SharedRenderer shared_;
  Deal deal_;
};

}  // namespace ubs
