// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/shared_renderer.hpp"

namespace ubs {

std::vector<Bytes> SharedRenderer::exchange(const Pieces& pieces) {
  for (std::size_t r = 0; r < pieces.size(); ++r)
    if (r != static_cast<std::size_t>(ranks_.rank())) sent_ += pieces[r].size();
  return ranks_.exchange(pieces);
}

std::optional<ListTotals> SharedRenderer::forward(const SplatView& own, std::span<const std::int64_t> cameras,
                                                  const RenderSettings& settings, bool for_backward) {
  own_ = own;
  settings_ = settings;
  cameras_.assign(cameras.begin(), cameras.end());
  ids_.assign(cameras.size(), {});
  std::vector<std::vector<float>> records(cameras.size());
  Pieces pieces;
  for (std::size_t r = 0; r < cameras.size(); ++r) {
    if (cameras[r] != kNoView) {
      ProjectedSplats seen = owner_.project_only(own, static_cast<std::uint32_t>(cameras[r]), settings);
      ids_[r] = std::move(seen.ids);
      records[r] = std::move(seen.records);
    }
    pieces.push_back(std::as_bytes(std::span(records[r])));
  }
  const std::vector<Bytes> come = exchange(pieces);
  const std::int64_t camera = cameras[static_cast<std::size_t>(ranks_.rank())];
  if (camera == kNoView) return {};
  std::vector<float> all;
  sizes_.clear();
  for (const Bytes& bytes : come) {
    const std::span<const float> part = as_values<float>(bytes);
    sizes_.push_back(part.size());
    all.insert(all.end(), part.begin(), part.end());
  }
  return drawer_.forward_projected(all, static_cast<std::uint32_t>(camera), settings, for_backward);
}

void SharedRenderer::backward() {
  static_assert(int{kGradStride} == int{kSplatStride});
  const bool drew = cameras_[static_cast<std::size_t>(ranks_.rank())] != kNoView;
  const std::vector<float> rows = drew ? drawer_.projected_gradient() : std::vector<float>{};
  Pieces pieces;
  std::size_t at = 0;
  for (std::size_t r = 0; r < cameras_.size(); ++r) {
    const std::size_t size = drew ? sizes_[r] : 0;
    pieces.push_back(std::as_bytes(std::span(rows).subspan(at, size)));
    at += size;
  }
  gradients_ = exchange(pieces);
}

Renderer& SharedRenderer::gradient_of(std::size_t rank) {
  owner_.take_gradient(own_, static_cast<std::uint32_t>(cameras_[rank]), settings_, ids_[rank],
                       as_values<float>(gradients_[rank]));
  return owner_;
}

}  // namespace ubs
