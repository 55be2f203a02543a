// SPDX-License-Identifier: Apache-2.0
// ViewPasses renders the views for training. It runs the forward and backward passes of the views of a step,
// and renders single views for an evaluation or for display. This class is for a single process. With several
// ranks, the derived class SharedViewPasses (shared_view_passes.hpp) divides the views of a step among the
// ranks, and all ranks must make the same calls.
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

// IntersectionCount counts the intersections, which are (tile, splat) pairs, of the training views so far:
// the maximum of a view, the number of the last view, the sum over all views, and the number of views.
struct IntersectionCount {
  std::uint64_t most = 0, last = 0, total = 0, views = 0;
  std::uint64_t repeated = 0;  // number of steps rendered again because a list was too long
  double mean() const { return views > 0 ? static_cast<double>(total) / static_cast<double>(views) : 0; }
  void add(std::uint64_t pairs);  // counts a view with this number of intersections
};

// StepViews describes the views of one training step.
struct StepViews {
  std::uint64_t first = 0, end = 0;         // range of draws
  const std::set<std::uint64_t>& left_out;  // draws that are skipped; also contains draws of other steps
  bool uncounted = false;                   // render without waiting for the size of the lists
  // For the last view, compute only the gradient of the records, which is then in learning_renderer().
  bool keeps_records = false;
  // Computes the loss of the image in renderer() and the gradient of the image.
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
  // Runs the forward and backward pass of each view and stores the sum of the gradients in
  // TrainedSplats::v_params(). Returns the number of views that were rendered.
  virtual int run(const StepViews& step);
  // Starts to copy the photograph of the first view of an iteration to the device.
  virtual void upload_first(int iteration) { views_.upload(views_.first_draw(iteration)); }
  // Returns the renderer whose method learn() completes a step.
  virtual Renderer& learning_renderer() { return renderer_; }
  // Combines the rows of all ranks, so that all ranks have the same rows. The first argument contains one row
  // per draw, which is valid on the rank that has rendered the view. The second argument is the number of
  // values per row.
  virtual void merge(BufferView<float>, std::size_t) const {}
  // Replaces the decisions in the first argument by those of the first rank. They may differ between ranks,
  // because they depend on the clock. If the sentinel of a rank (second argument, see Guard) shows that a
  // value is not finite, the sentinels of the other ranks are set to this iteration (third argument), so that
  // their next steps change nothing either.
  virtual void agree(std::span<bool>, BufferView<std::uint32_t>, int) const {}
  // Measures the test views, and the wide images of which they show parts. `more` and `fit` have the same
  // meaning as for evaluate(). With several ranks, only the first one gets the metrics of wide images.
  Metrics evaluate_test(ImageMetrics* more, Appearance fit);
  // Measures a training view at its current size. Not supported with several ranks.
  ViewMetrics evaluate_train(std::uint32_t view, Appearance fit);
  // Returns ViewMetrics::psnr_channel_mean of a test view. Not supported with several ranks.
  double test_psnr(std::uint32_t view);

 protected:
  virtual Metrics evaluate_test_views(ImageMetrics* more, Appearance fit);
  virtual Communicator& ranks() { return alone(); }
  // Measures one view against the photograph with the index `target`.
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
  int run(const StepViews& step, bool uncounted, std::vector<DeferredView>& views);
};

}  // namespace ubs
