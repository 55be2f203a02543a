// SPDX-License-Identifier: Apache-2.0
#include "host/train/shared_splats.hpp"

#include <algorithm>
#include <numeric>

#include "host/base/error.hpp"
#include "host/base/philox.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

// Returns the high 64 bits of the product of two 64-bit numbers. mcmc_draw in kernels/map/mcmc.cl computes
// them in the same way.
std::uint64_t high_product(std::uint64_t a, std::uint64_t b) {
  const std::uint64_t a0 = a & 0xffffffffu, a1 = a >> 32, b0 = b & 0xffffffffu, b1 = b >> 32;
  const std::uint64_t middle = a1 * b0 + (a0 * b0 >> 32), other = a0 * b1 + (middle & 0xffffffffu);
  return a1 * b1 + (middle >> 32) + (other >> 32);
}

std::uint32_t low_half(std::uint64_t v) { return static_cast<std::uint32_t>(v); }
std::uint32_t high_half(std::uint64_t v) { return static_cast<std::uint32_t>(v >> 32); }

// Returns the splats of `share` whose index is below `end`.
Share until(Share share, std::uint32_t end) {
  const std::uint32_t first = std::min(share.first, end);
  return {first, std::min(share.end(), end) - first};
}

Share overlap(const Share& a, const Share& b) {
  const std::uint32_t first = std::max(a.first, b.first), end = std::min(a.end(), b.end());
  return {first, end > first ? end - first : 0};
}

}  // namespace

std::unique_ptr<TrainedSplats> make_trained_splats(Communicator& ranks, Device& device, Stages& stages,
                                                   const SplatModel& initial, std::size_t capacity) {
  if (ranks.size() == 1) return std::make_unique<TrainedSplats>(device, stages, initial, capacity);
  return std::make_unique<SharedSplats>(ranks, device, stages, initial, capacity);
}

SplatModel part_of(const SplatModel& model, const Share& share) {
  SplatModel part(model.dim, share.count, model.variant);
  part.values = part_of(model.values, model.count, share);
  return part;
}

std::vector<float> part_of(std::span<const float> rows, std::size_t count, const Share& share) {
  std::vector<float> part;
  for (std::size_t at = share.first; at < rows.size(); at += count)
    part.insert(part.end(), rows.begin() + static_cast<std::ptrdiff_t>(at),
                rows.begin() + static_cast<std::ptrdiff_t>(at + share.count));
  return part;
}

SharedSplats::SharedSplats(Communicator& ranks, Device& device, Stages& stages, const SplatModel& initial,
                           std::size_t capacity)
    : TrainedSplats(
          device, stages,
          part_of(initial, share_of(static_cast<std::uint32_t>(initial.count), ranks.size(), ranks.rank())),
          largest_share(static_cast<std::uint32_t>(capacity), ranks.size())),
      ranks_(ranks),
      parts_{&model_.params(), &moment1_, &moment2_},
      total_(static_cast<std::uint32_t>(initial.count)),
      weights_(device, "mcmc weights", model_.stride()),
      copy_counts_(device, "mcmc copies", model_.stride()) {}

SplatModel SharedSplats::gather_model(bool everywhere) const {
  SplatModel all(model_.dim(), 0, model_.layout().variant);
  all.values = gather(model_.params(), everywhere);
  if (everywhere || ranks_.first()) all.count = total_;
  return all;
}

SplatModel SharedSplats::download() const { return gather_model(false); }

void SharedSplats::save(TrainState& state, bool everywhere) const {
  if (!everywhere) return TrainedSplats::save(state, false);
  state.model = gather_model(true);
  state.moment1 = gather(moment1_, true);
  state.moment2 = gather(moment2_, true);
}

void SharedSplats::load(const TrainState& state) {
  total_ = static_cast<std::uint32_t>(state.model.count);
  TrainState own;
  own.model = part_of(state.model, share());
  own.moment1 = part_of(state.moment1, total_, share());
  own.moment2 = part_of(state.moment2, total_, share());
  TrainedSplats::load(own);
}

std::vector<float> SharedSplats::row(const Buffer<float>& part, std::size_t row, std::uint32_t count) const {
  std::vector<float> values(count);
  part.download(std::span<float>(values), row * model_.stride());
  return values;
}

std::vector<std::uint32_t> SharedSplats::weigh(bool alive_only) {
  stages_.sampling_weights({model_.view(), alive_only, weights_.view(), copy_counts_.view()});
  std::vector<std::uint32_t> weights(model_.count());
  weights_.download(std::span<std::uint32_t>(weights));
  return weights;
}

std::uint32_t SharedSplats::relocate(float spread, std::uint64_t seed, std::uint64_t iteration) {
  const std::vector<std::uint32_t> weights = weigh(true);
  std::vector<Slot> dead;
  for (std::uint32_t i = 0; i < weights.size(); ++i)
    if (weights[i] == 0) dead.push_back({i, share().first + i});
  return replace({kDrawRelocate, true, spread, seed, iteration}, weights, dead);
}

void SharedSplats::grow(std::uint32_t target, float spread, std::uint64_t seed, std::uint64_t iteration) {
  move_parts(target);
  const Share now = share_of(target, ranks_.size(), ranks_.rank());
  std::vector<Slot> slots;
  for (std::uint32_t i = model_.count(); i < now.count; ++i) slots.push_back({i, now.first + i - total_});
  replace({kDrawGrow, false, spread, seed, iteration}, weigh(false), slots);
  model_.set_count(now.count);
  total_ = target;
}

// For each slot, a random number (a ticket) below the sum of the weights of all ranks is drawn. It selects a
// source splat with a probability that is proportional to its weight. The rank that holds the source sends a
// copy of it.
std::uint32_t SharedSplats::replace(const Draw& draw, const std::vector<std::uint32_t>& own_weights,
                                    std::span<const Slot> slots) {
  std::vector<std::uint32_t> weights = own_weights;
  const auto size = static_cast<std::size_t>(ranks_.size()), rank = static_cast<std::size_t>(ranks_.rank());
  std::vector<std::uint64_t> ends(size);
  const auto add_up = [&] {
    std::ranges::fill(ends, 0);
    ends[rank] = std::accumulate(weights.begin(), weights.end(), std::uint64_t{0});
    ranks_.sum(ends);
    std::partial_sum(ends.begin(), ends.end(), ends.begin());
  };
  add_up();
  if (ends.back() == 0) {
    if (draw.alive_only) return 0;
    // All opacities are zero or NaN, so growth selects all splats with equal probability.
    std::ranges::fill(weights, 1u);
    add_up();
  }
  std::vector<std::vector<std::uint64_t>> tickets(size);
  std::vector<std::size_t> owners;
  for (const Slot& slot : slots) {
    const PhiloxCounter words =
        philox4x32_10({slot.number, low_half(draw.iteration), high_half(draw.iteration), draw.purpose},
                      {low_half(draw.seed), high_half(draw.seed)});
    const std::uint64_t ticket =
        high_product(static_cast<std::uint64_t>(words[0]) << 32 | words[1], ends.back());
    owners.push_back(static_cast<std::size_t>(std::ranges::upper_bound(ends, ticket) - ends.begin()));
    tickets[owners.back()].push_back(ticket - (owners.back() > 0 ? ends[owners.back() - 1] : 0));
  }
  fill(slots, owners, answer(draw.spread, exchange_values(ranks_, tickets), weights));
  place(draw, slots);
  std::uint64_t drawn = slots.size();
  ranks_.sum(std::span(&drawn, 1));
  return static_cast<std::uint32_t>(drawn);
}

// Reduces the opacity and the size of the sources on this rank that were drawn, and sends the parameters of
// each of them, as a column, to the rank that drew it. Returns the columns that this rank receives.
std::vector<Bytes> SharedSplats::answer(float spread, const std::vector<Bytes>& tickets,
                                        const std::vector<std::uint32_t>& weights) {
  std::vector<std::uint64_t> ends(weights.begin(), weights.end());
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  std::vector<std::vector<std::uint32_t>> sources;
  std::vector<std::uint32_t> copies(weights.size());
  bool any = false;
  for (const Bytes& from : tickets) {
    std::vector<std::uint32_t>& ids = sources.emplace_back();
    for (const std::uint64_t ticket : as_values<std::uint64_t>(from)) {
      ids.push_back(static_cast<std::uint32_t>(std::ranges::upper_bound(ends, ticket) - ends.begin()));
      ++copies.at(ids.back());
      any = true;
    }
  }
  std::vector<std::vector<float>> columns(sources.size());
  if (any) {
    copy_counts_.upload(copies);
    stages_.split_sources({model_.view(), copy_counts_.view(), parts_[1]->view(), parts_[2]->view(), spread});
    for (std::size_t r = 0; r < rows_of(*parts_[0]); ++r) {
      const std::vector<float> values = row(*parts_[0], r, model_.count());
      for (std::size_t to = 0; to < sources.size(); ++to)
        for (const std::uint32_t id : sources[to]) columns[to].push_back(values[id]);
    }
  }
  return exchange_values(ranks_, columns);
}

// Writes the received columns into the slots, row by row, and sets the moments of the slots to zero. The
// columns from each rank are in the order of the slots that drew from it. No splat is both a source and a
// slot.
void SharedSplats::fill(std::span<const Slot> slots, std::span<const std::size_t> owners,
                        const std::vector<Bytes>& columns) {
  if (slots.empty()) return;
  const std::uint32_t count = std::max(model_.count(), slots.back().place + 1);
  for (std::size_t p = 0; p < parts_.size(); ++p)
    for (std::size_t r = 0; r < rows_of(*parts_[p]); ++r) {
      std::vector<float> values = row(*parts_[p], r, count);
      std::vector<std::size_t> next(columns.size());
      if (p == 0)
        for (std::size_t o = 0; o < columns.size(); ++o)
          next[o] = r * (columns[o].size() / sizeof(float) / rows_of(*parts_[p]));
      for (std::size_t i = 0; i < slots.size(); ++i)
        values[slots[i].place] = p == 0 ? as_values<float>(columns[owners[i]])[next[owners[i]]++] : 0.0f;
      parts_[p]->upload(values, r * model_.stride());
    }
}

void SharedSplats::place(const Draw& draw, std::span<const Slot> slots) {
  if (draw.spread == 0 || slots.empty()) return;
  const Slot first = slots.front();
  std::vector<std::uint32_t> sources(slots.back().place - first.place + 1, UBS_NO_SOURCE);
  for (const Slot& slot : slots) sources[slot.place - first.place] = 0;  // which source it was has no effect
  weights_.upload(sources);
  stages_.place_copies({.splats = model_.view(),
                        .first = first.place,
                        .slots = static_cast<std::uint32_t>(sources.size()),
                        .sources = weights_.view(),
                        .spread = draw.spread,
                        .purpose = draw.purpose,
                        .seed = draw.seed,
                        .iteration = draw.iteration,
                        .first_number = first.number});
}

// Moves the existing splats between ranks, so that they are distributed as required for a total of `target`
// splats.
void SharedSplats::move_parts(std::uint32_t target) {
  const int size = ranks_.size();
  const auto before = [&](int r) { return share_of(total_, size, r); };
  const auto after = [&](int r) { return until(share_of(target, size, r), total_); };
  bool moves = false;
  for (int r = 0; r < size; ++r)
    moves = moves || before(r).first != after(r).first || before(r).end() != after(r).end();
  if (!moves) return;
  const Share old = before(ranks_.rank()), now = after(ranks_.rank());
  std::vector<std::vector<float>> pieces(static_cast<std::size_t>(size));
  for (const Buffer<float>* part : parts_)
    for (std::size_t r = 0; r < rows_of(*part); ++r) {
      const std::vector<float> values = row(*part, r, old.count);
      for (int to = 0; to < size; ++to) {
        const Share piece = overlap(old, after(to));
        const auto first = values.begin() + (piece.count > 0 ? piece.first - old.first : 0);
        pieces[static_cast<std::size_t>(to)].insert(pieces[static_cast<std::size_t>(to)].end(), first,
                                                    first + piece.count);
      }
    }
  const std::vector<Bytes> come = exchange_values(ranks_, pieces);
  // Write zeros after the last splat, because kernels read whole vectors.
  const std::uint32_t padded =
      std::min((now.count + kShareBlock - 1) / kShareBlock * kShareBlock, model_.stride());
  std::vector<std::size_t> at(come.size());
  for (Buffer<float>* part : parts_)
    for (std::size_t r = 0; r < rows_of(*part); ++r) {
      std::vector<float> values;
      for (int from = 0; from < size; ++from) {
        const auto f = static_cast<std::size_t>(from);
        const std::uint32_t count = overlap(before(from), now).count;
        const std::span<const float> piece = as_values<float>(come[f]).subspan(at[f], count);
        values.insert(values.end(), piece.begin(), piece.end());
        at[f] += count;
      }
      values.resize(padded);
      part->upload(values, r * model_.stride());
    }
  model_.set_count(now.count);
}

std::vector<float> SharedSplats::gather(const Buffer<float>& part, bool everywhere) const {
  const Share own = share();
  std::vector<float> rows;
  for (std::size_t r = 0; r < rows_of(part); ++r) {
    const std::vector<float> values = row(part, r, own.count);
    rows.insert(rows.end(), values.begin(), values.end());
  }
  Pieces pieces(static_cast<std::size_t>(ranks_.size()));
  for (std::size_t r = 0; r < pieces.size(); ++r)
    if (everywhere || r == 0) pieces[r] = std::as_bytes(std::span(rows));
  const std::vector<Bytes> come = ranks_.exchange(pieces);
  std::vector<float> all;
  if (!everywhere && !ranks_.first()) return all;
  for (std::size_t r = 0; r < rows_of(part); ++r)
    for (const Bytes& bytes : come) {
      const std::span<const float> values = as_values<float>(bytes);
      const std::size_t count = values.size() / rows_of(part);
      all.insert(all.end(), values.begin() + static_cast<std::ptrdiff_t>(r * count),
                 values.begin() + static_cast<std::ptrdiff_t>((r + 1) * count));
    }
  return all;
}

}  // namespace ubs
