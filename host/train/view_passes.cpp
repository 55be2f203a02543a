// SPDX-License-Identifier: Apache-2.0
#include "host/train/view_passes.hpp"

#include <algorithm>

namespace ubs {
namespace {

constexpr std::uint64_t kViewsAhead = 3;  // images are decoded this many draws ahead

}  // namespace

void IntersectionCount::add(std::uint64_t pairs) {
  most = std::max(most, pairs);
  last = pairs;
  total += pairs;
  ++views;
}

std::uint64_t StepViews::last() const {
  std::uint64_t draw = end - 1;
  while (draw > first && left_out.contains(draw)) --draw;
  return draw;
}

void ViewPasses::draw(std::uint32_t camera) { renderer_.forward(splats_.view(), camera, settings_, false); }

// After all views of the step have been rendered, the host checks whether the capacity of their lists was
// sufficient. The gradients have not been used at this point. If a capacity was too small, all views of the
// step are rendered again, and the host waits for the size of each list. The results are therefore
// bit-identical to those of a run that always waits.
int ViewPasses::run(const StepViews& step) {
  std::vector<DeferredView> views;
  int drawn = run(step, step.uncounted, views);
  if (!std::ranges::all_of(views, &DeferredView::had_capacity)) {
    views.clear();
    drawn = run(step, false, views);
    ++intersections_.repeated;
  }
  for (DeferredView& view : views) intersections_.add(view.totals().intersections);
  return drawn;
}

int ViewPasses::run(const StepViews& step, bool uncounted, std::vector<DeferredView>& views) {
  int drawn = 0;
  const std::uint64_t last = step.last();
  for (std::uint64_t draw = step.first; draw < step.end; ++draw) {
    const std::uint32_t view = views_.view_of(draw);
    views_.prefetch(draw + kViewsAhead);
    if (step.left_out.contains(draw)) continue;
    const RenderSettings settings = views_.settings_of(draw, settings_);
    if (uncounted)
      views.push_back(renderer_.forward_deferred(splats_.view(), view, settings));
    else  // waits for the size of the lists
      views.emplace_back(renderer_.forward(splats_.view(), view, settings, true));
    step.loss(draw);
    if (draw == last && step.keeps_records)
      renderer_.backward_to_records();
    else
      renderer_.backward(splats_.v_params(), drawn > 0);
    ++drawn;
    if (draw + 1 < step.end) views_.upload(draw + 1);
  }
  return drawn;
}

Metrics ViewPasses::evaluate_test(ImageMetrics* more, Appearance fit) {
  Metrics metrics = evaluate_test_views(more, fit);
  const std::vector<View>& views = views_.test().views;
  if (std::ranges::none_of(views, [](const View& view) { return view.wide != nullptr; })) return metrics;
  const auto draw_faces = [&](const std::vector<Camera>& faces) {
    set_cameras(faces);
    std::vector<RenderedView> renders;
    for (std::uint32_t i = 0; i < faces.size(); ++i) {
      draw(i);
      if (ranks().first()) renders.push_back(renderer_.download());
    }
    return renders;
  };
  metrics.wide_images =
      measure_wide_images(device_, stages_, draw_faces, ranks(), views, views_.test_cameras(), more, fit);
  add_mean(metrics);
  set_cameras(views_.cameras());
  return metrics;
}

Metrics ViewPasses::evaluate_test_views(ImageMetrics* more, Appearance fit) {
  return evaluate(device_, stages_, renderer_, splats_.view(), settings_, views_.test().views,
                  views_.targets(), first_test(), more, fit);
}

Metrics ViewPasses::evaluate_one(const View& view, std::uint32_t target, Appearance fit) {
  const std::vector<View> named{
      {.name = view.name, .part_of = view.part_of}};  // without a copy of its pixels
  return evaluate(device_, stages_, renderer_, splats_.view(), settings_, named, views_.targets(), target,
                  nullptr, fit);
}

ViewMetrics ViewPasses::evaluate_train(std::uint32_t view, Appearance fit) {
  return evaluate_one(views_.train().views[view], view, fit).views[0];
}

double ViewPasses::test_psnr(std::uint32_t view) {
  return evaluate_one(views_.test().views[view], first_test() + view, Appearance::none)
      .mean.psnr_channel_mean;
}

}  // namespace ubs
