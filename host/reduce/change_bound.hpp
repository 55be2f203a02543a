// SPDX-License-Identifier: Apache-2.0
// By how much a reduced model's image differs from the original's, and a bound on it for every pixel that
// follows from the changes of the splats alone.
//
// Let T_j be the light left in front of splat j at a pixel, a_j its alpha, c_j its colour, B_j the colour of
// all that lies behind it. Taking j away changes the pixel by T_j a_j (B_j - c_j); changing its alpha by T_j
// (a_j' - a_j) (c_j - B_j). Done from back to front, no step changes the T of a later one, and B_j stays a
// mean of colours of the tile and the background. With G their range, and D = sum_j T_j |a_j' - a_j| (a_j' =
// 0 where a splat goes),
//   |change of the pixel| <= G D.
// Splats that change place in the depth order of a tile count as taken away (D of the original) and put back
// (D of the reduced model, with its T). Where either image's pixel is finished (at most 1e-4 of the light
// left) the other one may go on with what was left, T_stop: then G (D + T_stop + D).
#pragma once

#include <cstdint>
#include <vector>

#include "host/pipeline/device_groups.hpp"
#include "host/reduce/reducer.hpp"

namespace ubs::reduce {

// Added to the bound of pixels with changed splats for the rounding of float32 in both images.
inline constexpr double kRounding = 1e-5;

struct ViewChange {
  double measured_max = 0, measured_rms = 0;  // of the pixels' channels, not clamped
  double bound_max = 0, bound_rms = 0;
  double worst_ratio = 0;        // largest measured / bound
  std::size_t values = 0;        // pixels times channels
  std::size_t beyond_bound = 0;  // values where the measured change exceeds the bound
  bool identical = false;        // to the bit
};

// Scratch of the comparison, reused from view to view.
class ChangeBound {
 public:
  ChangeBound(Device& device, const Reduced& reduced);

  // Both renderers have just drawn the same view: `before` the original model, `after` the reduced one.
  ViewChange compare(Stages& before_stages, const Renderer& before, Stages& after_stages,
                     const Renderer& after, const RenderSettings& render);

 private:
  struct Lists;
  Lists download(const Renderer& renderer, std::size_t splats) const;
  void mark(const Lists& before, const Lists& after, std::size_t tiles);

  Device& device_;
  const Reduced& reduced_;
  std::vector<std::uint32_t> old_index_;
  std::vector<std::uint32_t> partners_before_, partners_after_;
  std::vector<std::uint32_t> place_, stamp_;
  Buffer<std::uint32_t> partners_;
  Buffer<float> changes_, stops_;
};

}  // namespace ubs::reduce
