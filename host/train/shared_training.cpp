// SPDX-License-Identifier: Apache-2.0
// Trainer's part in a training that several ranks share (docs/cluster.md).
#include <algorithm>
#include <array>
#include <cmath>

#include "host/train/trainer.hpp"

namespace ubs {

std::vector<double> Trainer::picture_differences(std::uint32_t view) {
  const auto size = static_cast<std::size_t>(ranks_.size());
  draw_shared(std::vector<std::int64_t>(size, view));
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

void Trainer::draw_shared(std::vector<std::int64_t> cameras) {
  SharedRenderer::Round round = sharing_->views.begin(model_.view(), std::move(cameras), render_settings());
  sharing_->views.forward(round, false);
}

// Gradients are added in the order of the draws, each by the rank that has the splats. While the device draws
// the views of a round, the records of the next one and the gradients of the one before travel.
int Trainer::render_shared_views() {
  SharedRenderer& shared = sharing_->views;
  const auto rank = static_cast<std::size_t>(ranks_.rank());
  const auto& deal = sharing_->deal.rounds();
  const std::set<std::uint64_t>& skipped = progress_.skipped_draws;
  const std::uint64_t first = views_.first_draw(progress_.iteration), last = last_draw();
  const auto draw_of = [&](std::size_t round, std::size_t r) {
    return first + static_cast<std::uint64_t>(deal[round][r]);
  };
  const auto drawn_in = [&](std::size_t round, std::size_t r) {
    return deal[round][r] != kNoView && !skipped.contains(draw_of(round, r));
  };
  const auto begin = [&](std::size_t round) {
    std::vector<std::int64_t> cameras(deal[round].size(), kNoView);
    for (std::size_t r = 0; r < cameras.size(); ++r)
      if (drawn_in(round, r)) cameras[r] = views_.view_of(draw_of(round, r));
    return shared.begin(model_.view(), std::move(cameras), render_settings());
  };
  int drawn = 0;
  const auto add_gradients = [&](std::size_t number, const SharedRenderer::Round& round) {
    const BufferView<float> v_params = learning_.v_params.view();
    for (std::size_t r = 0; r < deal[number].size(); ++r) {
      if (!drawn_in(number, r)) continue;
      if (model_.count() > 0) {
        Renderer& owner = shared.gradient_of(round, r);
        if (draw_of(number, r) != last || !learns_at_once())
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
    if (const auto totals = shared.forward(now, true)) {
      count(totals->intersections);
      loss_of(draw_of(i, rank));
      renderer_.backward_to_records();
    }
    if (own_next) views_.upload(draw_of(i + 1, rank));
    if (i > 0) shared.receive_gradients(before);
    shared.send_gradients(now);
    if (i > 0) add_gradients(i - 1, before);
    before = std::move(now);
    now = std::move(next);
  }
  shared.receive_gradients(before);
  add_gradients(deal.size() - 1, before);
  return drawn;
}

// Rows by draw, of which each rank has those of the views that it draws.
void Trainer::merge_by_draw(BufferView<float> rows, std::size_t width) const {
  if (rows.size == 0) return;
  std::vector<float> values = read_values(device_, rows, rows.size);
  for (std::size_t i = 0; i < values.size(); ++i)
    if (sharing_->deal.rank_of(i / width % views_.batch()) != ranks_.rank()) values[i] = 0;
  ranks_.merge(values);
  device_.write(*rows.memory, 0, std::as_bytes(std::span(values)));
}

// What follows from the clock is as the first rank has it; and a value that one rank has found not finite
// stops the steps of all.
void Trainer::agree(bool& by_time, bool& saves) {
  if (!sharing_) return;
  std::array<std::uint64_t, 3> words{ranks_.first() && by_time, ranks_.first() && saves, 0};
  const BufferView<std::uint32_t> sentinel = guard_.sentinel();
  std::uint32_t stamp = 0;
  const auto bytes = std::span(&stamp, 1);
  if (sentinel.size > 0) device_.read(*sentinel.memory, 0, std::as_writable_bytes(bytes));
  words[2] = stamp != 0;
  ranks_.sum(words);
  by_time = words[0] != 0;
  saves = words[1] != 0;
  if (words[2] == 0 || stamp != 0) return;
  stamp = static_cast<std::uint32_t>(progress_.iteration);
  device_.write(*sentinel.memory, 0, std::as_bytes(bytes));
}

}  // namespace ubs
