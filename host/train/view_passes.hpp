// SPDX-License-Identifier: Apache-2.0
// ViewPasses draws the views of a training: forward and backward pass of those of a step, and any view for an
// evaluation or a picture. This class is for one process. With SharedViewPasses (shared_view_passes.hpp)
// several ranks divide the views of a step among them; then all ranks make the same calls.
#pragma once

#include <cstdint>
#include <functional>
#include <set>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/train/evaluate.hpp"
#include "host/train/trained_splats.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

// (tile, splat) pairs of the training views so far.
struct IntersectionCount {
  std::uint64_t most = 0, last = 0, total = 0, views = 0;
  std::uint64_t repeated = 0;  // steps that were drawn again, because a view had no room for its lists
  double mean() const { return views > 0 ? static_cast<double>(total) / static_cast<double>(views) : 0; }
  void add(std::uint64_t pairs);
};

// The views of one step.
struct StepViews {
  std::uint64_t first = 0, end = 0;         // draws
  const std::set<std::uint64_t>& left_out;  // of all draws
  bool uncounted = false;                   // do not wait for the size of the lists
  bool keeps_records = false;  // of the last view that is drawn: learning_renderer() has its gradient
  std::function<void(std::uint64_t draw)> loss;  // of what renderer() has drawn, and its gradient

  std::uint64_t last() const;  // draw that is not left out
};

class ViewPasses {
 public:
  ViewPasses(Device& device, Stages& stages, TrainingViews& views, TrainedSplats& splats,
             const RenderSettings& settings)
      : device_(device),
        stages_(stages),
        views_(views),
        splats_(splats),
        settings_(settings),
        renderer_(device, stages) {}
  virtual ~ViewPasses() = default;
  ViewPasses(const ViewPasses&) = delete;
  ViewPasses& operator=(const ViewPasses&) = delete;

  const RenderSettings& settings() const { return settings_; }
  Renderer& renderer() { return renderer_; }
  const Renderer& renderer() const { return renderer_; }
  const IntersectionCount& intersections() const { return intersections_; }

  virtual void set_cameras(const std::vector<Camera>& cameras) { renderer_.set_cameras(cameras); }
  // Draws a view of these cameras into renderer() of the first rank.
  virtual void draw(std::uint32_t camera);
  // Forward and backward pass of each view, into TrainedSplats::v_params(). Returns how many were drawn.
  virtual int run(const StepViews& step);
  // Copies to the device what the first view of an iteration wants.
  virtual void upload_first(int iteration) { views_.upload(views_.first_draw(iteration)); }
  // What Renderer::learn() of a step is called on.
  virtual Renderer& learning_renderer() { return renderer_; }
  // Makes rows that are written by draw, `width` values each, the same on all ranks.
  virtual void merge(BufferView<float>, std::size_t) const {}
  // Of the test views; `more` and `fit` as for evaluate().
  virtual Metrics evaluate_test(ImageMetrics* more, Appearance fit);

 protected:
  std::uint32_t first_test() const { return static_cast<std::uint32_t>(views_.train().views.size()); }

  Device& device_;
  Stages& stages_;
  TrainingViews& views_;
  TrainedSplats& splats_;
  const RenderSettings settings_;
  Renderer renderer_;
  IntersectionCount intersections_;

 private:
  int run(const StepViews& step, bool uncounted, std::vector<UncountedView>& views);
};

}  // namespace ubs
