// SPDX-License-Identifier: Apache-2.0
#include "host/bench/cost_model.hpp"

#include <algorithm>
#include <bit>

#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs::bench {
namespace {

constexpr double kRecord = 4 * kSplatStride, kSlot = 4 * kGradStride;
constexpr double kExp = 8;

// One splat at one pixel (kernels/math/blend.h): distance 9, polynomial power 26, alpha and transmittance 6,
// colour 6, with comparisons and selects 55; backward repeats it and adds ten derivatives: 110.
constexpr double kForwardPair = 55, kBackwardPair = 110;
constexpr double kLogarithm = 13;  // of the power; a Gaussian has none
// Vector instructions of a 4x4 block: counted in the disassembly of the AVX-512 forward prototype; backward
// from the same count, that is two thirds more (measured time over the forward's fraction of its bound). Not
// counted for Gaussians, which have no estimate of the issue bound.
constexpr double kForwardInstructions = 62, kBackwardInstructions = 105;
constexpr double kBlockPixels = 16;
// SSIM: five windowed moments of 2 x 11 taps (an FMA each) and the quotient, and three maps back.
constexpr double kLossPerValue = 5 * 44 + 30 + 3 * 44 + 20;

struct Amounts {
  double splats, visible, pairs, active, blocks, blended, pixels, rows;
  double projection;   // operations a splat
  double logarithm;    // operations of a pair that the form has not
  bool chunks;         // lists of CPUs
  double tile_passes;  // of 8 bits, by tile
};

Cost project_forward(const Amounts& a) {
  // Reads every parameter, writes key, rect and count of all splats and the record of the drawn ones.
  return {a.splats * (4 * a.rows + 16) + a.visible * kRecord, a.splats * a.projection, 0};
}

// Lists of CPUs (kernels/opencl/tile_list_chunks.cl). Counting reads counts and keys, the first pass by depth
// as well, which also writes offsets and the words (key and id) of the drawn splats. Of the passes after it,
// one up to a million splats, else three, a histogram reads the words and a scatter reads and writes them,
// the last one only the ids. One pass by tile: ids and rects twice, offsets, two words an intersection.
Cost lists_by_chunks(const Amounts& a) {
  const double between = a.splats < 1 << 20 ? 0 : 2;
  return {20 * a.splats + a.visible * (8 + between * 24 + 20) + a.visible * (2 * 12 + 4) + 8 * a.pairs, 0, 0};
}

// Lists of GPUs. Counting: reads counts, writes offsets and ids. Keys are gathered; one histogram of all
// digits reads them, four passes by depth read and write key and id. Areas: ids and rects in, a word out,
// their prefix sum in and out. Emission reads it, ids and rects and writes tile and id of the intersections;
// passes of 8 bits by tile read and write both behind a histogram; slots come from tile and id.
Cost lists_by_groups(const Amounts& a) {
  const double count = 8 * a.splats + 4 * a.visible, gather = 12 * a.visible;
  const double depth = a.visible * (4 + 4 * 16), place = a.visible * (16 + 8 + 16);
  return {count + gather + depth + place + a.pairs * (8 + 4 + 16 * a.tile_passes + 8 + 4), 0, 0};
}

Cost lists(const Amounts& a) { return a.chunks ? lists_by_chunks(a) : lists_by_groups(a); }

Cost raster_forward(const Amounts& a) {
  // Each tile reads its list and the records on it, writes the masks, then the image and transmittance.
  return {a.pairs * (8 + 2) + a.pairs * kRecord + 16 * a.pixels, (kForwardPair - a.logarithm) * a.blended,
          a.blocks * kForwardInstructions * kBlockPixels};
}

Cost raster_backward(const Amounts& a) {
  return {a.pairs * (8 + 2) + a.active * (kRecord + kSlot) + 24 * a.pixels,
          (kBackwardPair - a.logarithm) * a.blended, a.blocks * kBackwardInstructions * kBlockPixels};
}

Cost image_loss(const Amounts& a) {
  // Image (float) and target (byte) of three channels in, gradient out; the three maps between the two passes
  // out and in.
  return {3 * a.pixels * (4 + 1 + 4 + 2 * 3 * 4 + 4 + 1), 3 * a.pixels * kLossPerValue, 0};
}

Cost sum_slots(const Amounts& a) {
  return {a.active * kSlot + 2 * a.pairs + a.splats * (8 + kSlot), a.active * 10, 0};
}

Cost project_backward(const Amounts& a) {
  // Forward is repeated; its reverse costs twice as much. Splats that are not drawn get a gradient of zero.
  return {a.visible * (4 * a.rows + kSlot) + a.splats * (4 + 4 * a.rows), 3 * a.visible * a.projection, 0};
}

// Parameter, gradient and two moments in; parameter and moments out.
Cost adam(const Amounts& a) { return {a.splats * a.rows * 4 * 7, a.splats * a.rows * 14, 0}; }

// Opacity row in, its gradient in and out.
Cost regularise(const Amounts& a) { return {a.splats * 12, a.splats * (2 * kExp + 4), 0}; }

// Backward projection, penalties and Adam with a gradient that stays in registers.
Cost learn(const Amounts& a) {
  return {a.splats * a.rows * 4 * 6 + a.visible * kSlot,
          project_backward(a).flops + regularise(a).flops + adam(a).flops, 0};
}

// Weights, copies and prefix out and in; a search in the prefix for every splat is latency, not counted.
Cost relocate(const Amounts& a) { return {a.splats * (4 + 2 * 4 * 3 + 4), a.splats * kExp, 0}; }

// As relocation; 2 % new splats with all parameters, read and written.
Cost grow(const Amounts& a) {
  const Cost base = relocate(a);
  return {base.bytes + 0.02 * a.splats * a.rows * 8, base.flops, 0};
}

// Position in and out, opacity, spatial scale and rotation in; three normal numbers and a 3x3 product.
Cost noise(const Amounts& a) { return {a.splats * 4 * (2 * 3 + 1 + 3 + 3), a.splats * (6 * kExp + 120), 0}; }

Cost sum(std::initializer_list<Cost> parts) {
  Cost total;
  for (const Cost& part : parts) {
    total.bytes += part.bytes;
    total.flops += part.flops;
    total.issue_lanes += part.issue_lanes;
  }
  return total;
}

}  // namespace

double projection_flops(const ParameterLayout& layout) {
  const double c = layout.query, width = layout.dim;
  // LQ factor by Gram-Schmidt: per row norms and scaling, per pair of rows a dot and an update. Solves: y, z,
  // three columns. Query values: softplus, exp, ln(1 - tanh), sigmoid. Results: offset and shrinkage.
  // Direct form: two triangular products and an offset.
  const bool direct = layout.variant.direct();
  const double factor = direct ? 0 : c * 5 * width + c * (c - 1) / 2 * 4 * width,
               solves = (direct ? 2 : 5) * c * c;
  const double query = c * (5 * kExp + 20), result = c * (direct ? 8 : 24);
  // Frame with three softplus, M K and its product, mean, view transform and EWA projection, conic factor,
  // three activations.
  const double base = 9 + 3 * 2 * kExp + 45 + 30 + 24 + 120 + 20 + 3 * kExp;
  // A basis function of about two operations and its product with three colours.
  const double colour = layout.variant.harmonics() * 8.0 + layout.variant.lobes() * (60 + 4 * kExp);
  return base + factor + solves + query + result + colour;
}

Cost stage_cost(std::string_view stage, const WorkCounts& counts) {
  const auto real = [](std::uint64_t n) { return static_cast<double>(n); };
  const bool gaussian = counts.layout.variant.kernel == SpatialKernel::gaussian;
  const Amounts a{
      .splats = real(counts.splats),
      .visible = real(counts.visible),
      .pairs = real(counts.intersections),
      .active = real(counts.active_pairs),
      .blocks = gaussian ? 0 : real(counts.blocks),
      .blended = real(counts.blended),
      .pixels = real(counts.pixels),
      .rows = static_cast<double>(counts.layout.count),
      .projection = projection_flops(counts.layout),
      .logarithm = gaussian ? kLogarithm : 0,
      .chunks = counts.lists == RasterKind::cpu,
      .tile_passes = real(
          (static_cast<unsigned>(std::bit_width(std::max<std::uint64_t>(1, counts.tiles) - 1)) + 7) / 8)};
  if (stage == "project_forward") return project_forward(a);
  if (stage == "lists") return lists(a);
  if (stage == "raster_forward") return raster_forward(a);
  if (stage == "image_loss") return image_loss(a);
  if (stage == "raster_backward") return raster_backward(a);
  if (stage == "sum_slots") return sum_slots(a);
  if (stage == "project_backward") return project_backward(a);
  if (stage == "adam") return adam(a);
  if (stage == "regularise") return regularise(a);
  if (stage == "learn") return learn(a);
  if (stage == "relocate") return relocate(a);
  if (stage == "grow") return grow(a);
  if (stage == "noise") return noise(a);
  if (stage == "render") return sum({project_forward(a), lists(a), raster_forward(a)});
  if (stage == "forward_backward")
    return sum({project_forward(a), lists(a), raster_forward(a), raster_backward(a), sum_slots(a),
                project_backward(a)});
  if (stage == "iteration")
    return sum({project_forward(a), lists(a), raster_forward(a), image_loss(a), raster_backward(a),
                sum_slots(a), learn(a)});
  return {};
}

}  // namespace ubs::bench
