// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/shared_renderer.hpp"

namespace ubs {

std::unique_ptr<Exchange> SharedRenderer::start(const Pieces& pieces) {
  for (std::size_t r = 0; r < pieces.size(); ++r)
    if (r != static_cast<std::size_t>(ranks_.rank())) sent_ += pieces[r].size();
  return ranks_.start(pieces);
}

SharedRenderer::Round SharedRenderer::begin(const SplatView& own, std::vector<std::int64_t> cameras,
                                            const RenderSettings& settings) {
  Round round{.own = own, .settings = settings, .cameras = std::move(cameras)};
  const std::size_t ranks = round.cameras.size();
  round.ids.resize(ranks);
  round.records.resize(ranks);
  Pieces pieces;
  for (std::size_t r = 0; r < ranks; ++r) {
    if (round.cameras[r] != kNoView) {
      ProjectedSplats seen = owner_.project_only(own, static_cast<std::uint32_t>(round.cameras[r]), settings);
      round.ids[r] = std::move(seen.ids);
      round.records[r] = std::move(seen.records);
    }
    pieces.push_back(r == own_rank() ? std::span<const std::byte>()
                                     : std::as_bytes(std::span(round.records[r])));
  }
  round.on_the_way = start(pieces);
  return round;
}

std::optional<ListTotals> SharedRenderer::forward(Round& round, bool for_backward) {
  const std::vector<Bytes> come = round.on_the_way->finish();
  const std::vector<float> own = std::move(round.records[own_rank()]);
  round.records.clear();
  const std::int64_t camera = round.cameras[own_rank()];
  if (camera == kNoView) return {};
  std::vector<std::span<const float>> parts;
  for (std::size_t r = 0; r < come.size(); ++r) {
    parts.push_back(r == own_rank() ? std::span<const float>(own) : as_values<float>(come[r]));
    round.sizes.push_back(parts.back().size());
  }
  return drawer_.forward_projected(parts, static_cast<std::uint32_t>(camera), round.settings, for_backward);
}

void SharedRenderer::send_gradients(Round& round) {
  static_assert(int{kGradStride} == int{kSplatStride});
  const bool drew = !round.sizes.empty();
  if (drew) round.v_records = drawer_.projected_gradient();
  Pieces pieces;
  std::size_t at = 0;
  for (std::size_t r = 0; r < round.cameras.size(); ++r) {
    const std::span<const float> piece = std::span(round.v_records).subspan(at, drew ? round.sizes[r] : 0);
    if (r == own_rank()) round.own_gradient = piece;
    pieces.push_back(r == own_rank() ? std::span<const std::byte>() : std::as_bytes(piece));
    at += piece.size();
  }
  round.on_the_way = start(pieces);
}

Renderer& SharedRenderer::gradient_of(const Round& round, std::size_t rank) {
  owner_.take_gradient(round.own, static_cast<std::uint32_t>(round.cameras[rank]), round.settings,
                       round.ids[rank],
                       rank == own_rank() ? round.own_gradient : as_values<float>(round.come[rank]));
  return owner_;
}

}  // namespace ubs
