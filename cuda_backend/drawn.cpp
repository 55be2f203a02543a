// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/drawn.hpp"

#include "cuda_backend/grid.hpp"

namespace ubs::cuda {

u32 Drawn::place(const PlaceDrawn& a) {
  reserve(device_, marks_, "marks of drawn splats", a.count + std::size_t{1});
  device_.launch("mark_drawn", kernels_.mark, blocks(a.count + std::uint64_t{1}, kMapBlock), kMapBlock,
                 a.tile_counts, a.count, marks_.view());
  device_.algorithm("place_drawn", [&](Workspace& workspace) {
    return scan_exclusive(workspace, pointer_of(marks_.view()), pointer_of(a.places), a.count + 1,
                          device_.stream());
  });
  u32 drawn = 0;
  device_.read(*a.places.memory, a.count * sizeof(drawn), std::as_writable_bytes(std::span(&drawn, 1)));
  return drawn;
}

void Drawn::pick(const PickDrawn& a) {
  device_.launch("pick_drawn", kernels_.pick, blocks(a.count, kMapBlock), kMapBlock, a.records, a.tile_rects,
                 a.places, a.count, a.drawn);
}

void Drawn::unpack(const UnpackDrawn& a) {
  device_.launch("unpack_drawn", kernels_.unpack, blocks(a.count, kMapBlock), kMapBlock, a.records, a.count,
                 a.depth_keys, a.tile_rects, a.tile_counts);
}

void Drawn::spread(const SpreadGradient& a) {
  device_.launch("spread_gradient", kernels_.spread, blocks(a.count, kMapBlock), kMapBlock, a.drawn, a.places,
                 a.count, a.v_records);
}

}  // namespace ubs::cuda
