// SPDX-License-Identifier: Apache-2.0
#include "host/train/shared_view_passes.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {

void SharedViewPasses::set_cameras(const std::vector<Camera>& cameras) {
  ViewPasses::set_cameras(cameras);
  shared_.set_cameras(cameras);
}

void SharedViewPasses::draw_round(std::vector<std::int64_t> cameras) {
  SharedRenderer::Round round = shared_.begin(splats_.view(), std::move(cameras), settings_);
  shared_.forward(round, false);
}

void SharedViewPasses::draw(std::uint32_t camera) {
  std::vector<std::int64_t> cameras(static_cast<std::size_t>(ranks_.size()), kNoView);
  cameras[0] = camera;
  draw_round(std::move(cameras));
}

std::vector<double> SharedViewPasses::picture_differences(std::uint32_t view) {
  const auto size = static_cast<std::size_t>(ranks_.size());
  draw_round(std::vector<std::int64_t>(size, view));
  const std::vector<float> own = renderer_.download().rgb;
  std::vector<std::vector<float>> to_first(size);
  to_first[0] = own;
  const std::vector<Bytes> of_ranks = exchange_values(ranks_, to_first);
  std::vector<double> largest(size);
  for (std::size_t r = 0; r < size; ++r)
    for (std::size_t i = 0; const float value : as_values<float>(of_ranks[r]))
      largest[r] = std::max(largest[r], std::abs(double{value} - own[i++]));
  return largest;
}

Metrics SharedViewPasses::evaluate_test_views(ImageMetrics* more, Appearance fit) {
  const std::vector<View>& views = views_.test().views;
  const auto draw = [&](std::size_t own) {
    std::vector<std::int64_t> cameras(static_cast<std::size_t>(ranks_.size()), kNoView);
    const std::size_t round = own - static_cast<std::size_t>(ranks_.rank());
    for (std::size_t r = 0; r < cameras.size() && round + r < views.size(); ++r)
      cameras[r] = static_cast<std::int64_t>(first_test() + round + r);
    draw_round(std::move(cameras));
  };
  return evaluate(device_, stages_, renderer_, draw, ranks_, views, views_.targets(), first_test(), more,
                  fit);
}

// Uploads the image of the first view that this rank renders.
void SharedViewPasses::upload_first(int iteration) {
  const std::int64_t view = deal_.rounds()[0][static_cast<std::size_t>(ranks_.rank())];
  if (view != kNoView) views_.upload(views_.first_draw(iteration) + static_cast<std::uint64_t>(view));
}

// The rank that holds a splat adds the gradients of the splat in the order of the draws. While the device
// renders the views of a round, the records of the next round and the gradients of the previous round are
// transferred.
int SharedViewPasses::run(const StepViews& step) {
  const auto rank = static_cast<std::size_t>(ranks_.rank());
  const auto& deal = deal_.rounds();
  const std::uint64_t last = step.last();
  const auto draw_of = [&](std::size_t round, std::size_t r) {
    return step.first + static_cast<std::uint64_t>(deal[round][r]);
  };
  const auto drawn_in = [&](std::size_t round, std::size_t r) {
    return deal[round][r] != kNoView && !step.left_out.contains(draw_of(round, r));
  };
  const auto begin = [&](std::size_t round) {
    std::vector<std::int64_t> cameras(deal[round].size(), kNoView);
    for (std::size_t r = 0; r < cameras.size(); ++r)
      if (drawn_in(round, r)) cameras[r] = views_.view_of(draw_of(round, r));
    const bool own = deal[round][rank] != kNoView;
    return shared_.begin(splats_.view(), std::move(cameras),
                         own ? views_.settings_of(draw_of(round, rank), settings_) : settings_);
  };
  int drawn = 0;
  const auto add_gradients = [&](std::size_t number, const SharedRenderer::Round& round) {
    const BufferView<float> v_params = splats_.v_params();
    for (std::size_t r = 0; r < deal[number].size(); ++r) {
      if (!drawn_in(number, r)) continue;
      if (splats_.view().count > 0) {
        Renderer& owner = shared_.gradient_of(round, r);
        if (draw_of(number, r) != last || !step.keeps_records)
          owner.backward_from_records(std::span(&v_params, 1), drawn > 0);
      }
      ++drawn;
    }
  };
  SharedRenderer::Round before, now = begin(0), next;
  for (std::size_t i = 0; i < deal.size(); ++i) {
    const bool more = i + 1 < deal.size();
    if (more) next = begin(i + 1);
    const bool own_next = more && deal[i + 1][rank] != kNoView;
    if (own_next)
      views_.prefetch(draw_of(i + 1, rank));
    else if (deal[0][rank] != kNoView)
      views_.prefetch(draw_of(0, rank) + views_.batch());
    if (const auto totals = shared_.forward(now, true)) {
      intersections_.add(totals->intersections);
      step.loss(draw_of(i, rank));
      renderer_.backward_to_records();
    }
    if (own_next) views_.upload(draw_of(i + 1, rank));
    if (i > 0) shared_.receive_gradients(before);
    shared_.send_gradients(now);
    if (i > 0) add_gradients(i - 1, before);
    before = std::move(now);
    now = std::move(next);
  }
  shared_.receive_gradients(before);
  add_gradients(deal.size() - 1, before);
  return drawn;
}

// Each rank contributes the rows of the views that it renders. Afterwards, all ranks have all rows.
void SharedViewPasses::merge(BufferView<float> rows, std::size_t width) const {
  if (rows.size == 0) return;
  std::vector<float> values = read_values(device_, rows, rows.size);
  for (std::size_t i = 0; i < values.size(); ++i)
    if (deal_.rank_of(i / width % views_.batch()) != ranks_.rank()) values[i] = 0;
  ranks_.merge(values);
  device_.write(*rows.memory, 0, std::as_bytes(std::span(values)));
}

void SharedViewPasses::agree(std::span<bool> decisions, BufferView<std::uint32_t> sentinel,
                             int iteration) const {
  std::vector<std::uint64_t> words;
  for (const bool decision : decisions) words.push_back(ranks_.first() && decision);
  std::uint32_t stamp = 0;
  const auto bytes = std::span(&stamp, 1);
  if (sentinel.size > 0) device_.read(*sentinel.memory, 0, std::as_writable_bytes(bytes));
  words.push_back(stamp != 0);
  ranks_.sum(words);
  for (std::size_t i = 0; i < decisions.size(); ++i) decisions[i] = words[i] != 0;
  if (words.back() == 0 || stamp != 0) return;
  stamp = static_cast<std::uint32_t>(iteration);
  device_.write(*sentinel.memory, 0, std::as_bytes(bytes));
}

std::unique_ptr<ViewPasses> make_view_passes(Communicator& ranks, Device& device, Stages& stages,
                                             TrainingViews& views, TrainedSplats& splats,
                                             const RenderSettings& settings) {
  if (ranks.size() == 1) return std::make_unique<ViewPasses>(device, stages, views, splats, settings);
  return std::make_unique<SharedViewPasses>(ranks, device, stages, views, splats, settings);
}

}  // namespace ubs
