// SPDX-License-Identifier: Apache-2.0
// ViewPasses renders the views of a training: it runs the forward and backward passes of the views of a step,
// and renders any view for an evaluation or for display. This class is for one process. With SharedViewPasses
// (shared_view_passes.hpp), several ranks divide the views of a step among them; then all ranks must make the
// same calls.
#pragma once

#include <cstdint>
#include <functional>
#include <set>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/train/evaluate.hpp"
#include "host/train/trained_splats.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

// Intersections, which are (tile, splat) pairs, of the training views so far.
struct IntersectionCount {
  std::uint64_t most = 0, last = 0, total = 0, views = 0;
  std::uint64_t repeated = 0;  // steps that were rendered again because the lists of a view did not fit
  double mean() const { return views > 0 ? static_cast<double>(total) / static_cast<double>(views) : 0; }
  void add(std::uint64_t pairs);
};

// The views of one step.
struct StepViews {
  std::uint64_t first = 0, end = 0;         // range of draws
  const std::set<std::uint64_t>& left_out;  // draws that are skipped; also contains draws of other steps
  bool uncounted = false;                   // render without waiting for the size of the lists
  // For the last view, stop at the gradient of the records, in learning_renderer().
  bool keeps_records = false;
  // Computes the loss of the image in renderer(), and its gradient.
  std::function<void(std::uint64_t draw)> loss;

  std::uint64_t last() const;  // last draw that is not skipped
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
  // Renders the view of one of these cameras into renderer() of the first rank.
  virtual void draw(std::uint32_t camera);
  // Runs the forward and backward pass of each view and adds the gradients in TrainedSplats::v_params().
  // Returns how many views were rendered.
  virtual int run(const StepViews& step);
  // Starts to copy the photograph of the first view of an iteration to the device.
  virtual void upload_first(int iteration) { views_.upload(views_.first_draw(iteration)); }
  // Returns the renderer on which Renderer::learn() of a step must be called.
  virtual Renderer& learning_renderer() { return renderer_; }
  // Makes rows that are indexed by draw, with `width` values each, the same on all ranks.
  virtual void merge(BufferView<float>, std::size_t) const {}
  // Replaces decisions that may differ between ranks, because they depend on the clock, by those of the first
  // rank. If one rank has found a value that is not finite, sets the sentinels of the others (Guard) to this
  // iteration, so that the steps of all ranks stop.
  virtual void agree(std::span<bool>, BufferView<std::uint32_t>, int) const {}
  // Measures the test views and the wide images that they show parts of. `more` and `fit` are those of
  // evaluate(). With several ranks, only the first one gets the metrics of wide images.
  Metrics evaluate_test(ImageMetrics* more, Appearance fit);
  // Measures a training view in the same way, at its present size. Only for one process.
  ViewMetrics evaluate_train(std::uint32_t view, Appearance fit);
  // Returns ViewMetrics::psnr_channel_mean of one of the test views. Not for several ranks.
  double test_psnr(std::uint32_t view);

 protected:
  virtual Metrics evaluate_test_views(ImageMetrics* more, Appearance fit);
  virtual Communicator& ranks() { return alone(); }
  // Measures one view, whose image is that of the target.
  Metrics evaluate_one(const View& view, std::uint32_t target, Appearance fit);
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
