// SPDX-License-Identifier: Apache-2.0
// The upper layer between the pipeline and a back end: the operations of the method, each one plain struct of
// device views and scalars. The pipeline and the trainer know only
// these; a back end is free to fuse, split or choose kernels behind them as long as the contract holds.
// Buffer layouts are those of kernels/layout.h. Every operation is enqueued and returns at once,
// except where it says that it waits. Sums are taken in a fixed order: same inputs, same bits.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

#include "host/device/device.hpp"
#include "host/device/loss_weights.hpp"
#include "host/scene/math_mode.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs {

enum class RasterKind { cpu, gpu };  // pixel blocks with explicit vectors | one work-item a pixel

// What is compiled into the kernels. Anything that changes from iteration to iteration is an argument.
struct KernelConfig {
  int dim = 6;  // N
  RasterKind raster = RasterKind::cpu;
  bool query_grad = false;    // let the gradient flow through the view direction
  bool depth = false;         // forward rasteriser also writes expected depth
  bool depth_grad = false;    // gradients of projected splats have one of their depth (kGradDepth)
  ModelVariant variant = {};  // form of the method; fixes with `dim` the parameter rows
  float alpha_min = 0;        // contributions of alpha <= alpha_min are left out; 0: none are
  bool backward = true;  // false: forward only. Slots and masks do not exist, stages that learn are refused
  std::uint32_t frozen = 0;  // parameter groups that are not learnt (host/scene/frozen_groups.hpp)
  MathMode math = MathMode::exact;
};

// Pixel planes are padded to whole tiles (kTileSide of kernels/layout.h).
struct ImageShape {
  static constexpr int tile = 16;
  int width = 0, height = 0;
  int tiles_x() const { return (width + tile - 1) / tile; }
  int tiles_y() const { return (height + tile - 1) / tile; }
  int tiles() const { return tiles_x() * tiles_y(); }
  int pitch() const { return tiles_x() * tile; }
  int rows() const { return tiles_y() * tile; }
  std::size_t plane() const { return static_cast<std::size_t>(pitch()) * rows(); }
};

struct ProjectionSettings {
  float near_plane = 0.01f, far_plane = 1e10f;
  float eps2d = 0.3f;  // added to the projected support ellipse's diagonal [px^2]
};

struct SplatView {  // raw parameters on the device, row k of splat i at k * stride + i
  BufferView<float> params;
  std::uint32_t count = 0, stride = 0;  // stride is a multiple of 64
};

struct ProjectForward {  // raw parameters + one camera -> projected splats
  SplatView splats;
  BufferView<float> cameras;  // (views, kCameraStride)
  std::uint32_t camera = 0;   // row
  ImageShape shape;
  ProjectionSettings settings;
  // Splat i writes row first_record + i of the outputs; those have room for first_record + `stride` splats.
  // Up to `stride`, rows from first_record + `count` on become undefined: groups are projected in the order
  // of their rows.
  std::uint32_t first_record = 0;
  BufferView<float> records;              // out (rows, kSplatStride); undefined where culled
  BufferView<std::uint32_t> depth_keys;   // out: bits of depth, UBS_KEY_CULLED when not drawn
  BufferView<std::uint32_t> tile_rects;   // out (rows, 2): x0 | x1 << 16, y0 | y1 << 16, inclusive
  BufferView<std::uint32_t> tile_counts;  // out: tiles touched, 0 when not drawn
};

struct ListTotals {
  std::uint64_t visible = 0;        // splats drawn
  std::uint64_t intersections = 0;  // (tile, splat) pairs
};

struct CountLists {  // -> how much there is to list, first slot of each splat
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts;
  BufferView<std::uint32_t> depth_keys;  // those that build_lists is given: a device may begin to sort
  BufferView<std::uint32_t>
      slot_offsets;  // out (count): exclusive prefix sum of tile_counts; forward only: left alone
  // out (2), or empty: the totals, visible splats first. Where it is given count_lists does not wait: it
  // returns bounds, `count` and `room`. A view of more than `room` (< 2^32) intersections becomes one without
  // splats: its tile_counts are set to 0, and so it stays up to its gradient, which is 0.
  BufferView<std::uint64_t> totals = {};
  std::uint64_t room = 0;
};

struct BuildLists {  // -> per tile, splats in order of (depth, index); of the view counted last
  std::uint32_t count = 0;
  ListTotals totals;  // what the last count_lists returned
  ImageShape shape;
  BufferView<std::uint32_t> depth_keys, tile_rects, slot_offsets;
  BufferView<std::uint32_t> sorted_ids;    // out (intersections): splat
  BufferView<std::uint32_t> sorted_slots;  // out (intersections): slot_offsets[splat] + number of the tile in
                                           // its rect (row-major); forward only: left alone
  BufferView<std::uint32_t> tile_ranges;   // out (tiles + 1): first intersection of each tile
  bool bounded = false;  // it did not wait: `totals` are bounds, the numbers are on the device
  BufferView<std::uint32_t> long_lists = {};  // out (1), or empty: not 0 where a list has more than kLongList
                                              // entries; RasterKind::cpu: left alone
};

struct RasterForward {  // method.md 2.6
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  std::array<float, 3> background{0, 0, 0};
  BufferView<float> image;          // out (3, rows, pitch), not clamped
  BufferView<float> transmittance;  // out (rows, pitch): what is left of the light, 1 - alpha
  BufferView<float> depth;          // out (rows, pitch): expected depth; only with KernelConfig::depth
  BufferView<std::uint16_t>
      masks;  // out (intersections) by SLOT: 4x4 pixel blocks (bit 4 by + bx) of the tile that the splat
              // may change: those it reaches while they are open, at least every block where it is
              // composited or finishes a pixel; 0 = contributes nothing to the tile; forward only: left alone
  // out, list_state_floats(intersections) of stage_sizes.hpp: pixels in front of the segments of lists
  // (kernels/gpu/list_segments.h). RasterKind::cpu and forward only: empty
  BufferView<float> states;
  BufferView<std::uint32_t> long_lists = {};  // of BuildLists; empty: long lists are not divided
};

// Gradient slots of slot_floats() floats (stage_sizes.hpp): all in one buffer, or, where an allocation of the
// device does not hold them, slot s in piece s >> bits at place s modulo 2^bits.
struct SlotViews {
  static constexpr unsigned kMaxPieces = 8;
  std::array<BufferView<float>, kMaxPieces> pieces = {};
  unsigned count = 0, bits = 32;
};

struct RasterBackward {  // method.md 3.1; needs the forward's outputs of the same lists
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  BufferView<float> image;
  BufferView<std::uint16_t> masks;
  BufferView<float> states;
  BufferView<float> v_image;  // (3, rows, pitch); 0 outside width x height
  SlotViews slots;            // out, one an intersection; those of mask 0 may stay unwritten
};

struct SumSlots {  // sum of each splat's slots with mask != 0, in a fixed order
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts, slot_offsets;
  SlotViews slots;
  BufferView<std::uint16_t> masks;
  BufferView<float>
      records;  // of the splats: a rasteriser may leave to the sum what is the same in all slots of a splat
  // out (count, kGradStride), 0 behind kGradB; zero for splats without contribution
  BufferView<float> v_records;
};

// Gradients and moments have the rows of the parameters that are learnt, in the same order
// (KernelConfig::frozen).
struct ProjectBackward {  // gradient of projected splats -> gradient of raw parameters
  SplatView splats;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  ImageShape shape;
  ProjectionSettings settings;
  std::uint32_t first_record = 0;  // as in ProjectForward
  BufferView<float> v_records;
  BufferView<float> v_params;  // in/out (rows that are learnt, stride)
  bool accumulate = false;     // add to v_params (later views of a batch) instead of overwriting
};

// Gradient of projected splats -> gradient of the camera, the view direction's part included, whatever
// KernelConfig::query_grad says. In partial sums of a fixed order, which the host adds up. Nothing may be
// frozen.
struct CameraBackward {
  ProjectBackward gradient;    // without v_params and accumulate
  BufferView<float> v_camera;  // out (kCameraGrads, lanes)
  std::uint32_t lanes = 0;     // a multiple of 64
};

struct MeasureWeights {  // what the splats of a forward pass do to its pixels; kernels/opencl/weights.cl
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  BufferView<std::uint16_t> masks;
  BufferView<float> weights;  // out (intersections) by slot: largest transmittance * alpha in the tile
};

struct ImageLoss {  // weighted sum of mean|I - T| and 1 - SSIM (method.md 4.1) and its gradient
  ImageShape shape;
  BufferView<float> image;          // (3, rows, pitch)
  BufferView<std::uint8_t> target;  // (3, height, width) planar 8 bit: value / 255; or
  BufferView<float> target_float;   // (3, height, width) when `target` is empty
  // Pixels whose mask is 0 are taken as lying outside of the image: they and the windows around them do not
  // count, to other windows they are zero in image and target, their gradient is 0; means are over the
  // others.
  BufferView<std::uint8_t> mask;  // (height, width); empty: all pixels count
  std::uint32_t counted = 0;      // with a mask: how many pixels count
  LossWeights weights{0.8f, 0.2f};
  float scale = 1;            // of the gradient: 1 / batch
  bool clamp = false;         // evaluation: clamp the image to [0, 1] first
  BufferView<float> v_image;  // out (3, rows, pitch), 0 outside; left alone when empty
  BufferView<float> sums;     // out 8 floats at sums_offset: mean|I-T|, mean SSIM, mse r, g, b, 0, 0, 0
  std::uint32_t sums_offset = 0;
  // Exposure and white balance of the photograph: 12 numbers (kernels/math/appearance.h) by which the image
  // is mapped before it is compared; v_image is that of the image before. Empty: compared as it is.
  BufferView<float> appearance = {};
  std::uint32_t appearance_offset = 0;
  BufferView<float> v_appearance = {};  // out 12, where v_image is
  std::uint32_t v_appearance_offset = 0;
};
inline constexpr int kAppearanceNumbers = 12, kAppearanceState = 60;  // kernels/math/appearance.h

struct AppearanceStep {     // Adam of one image's numbers; then the mean over all images is brought back to 0
  BufferView<float> state;  // (images, 60): numbers, two moments, two bias corrections
  std::uint32_t images = 0, image = 0;
  BufferView<float> gradient;  // 12 at gradient_offset
  std::uint32_t gradient_offset = 0;
  float rate_diagonal = 0, rate_other = 0;  // 0: those numbers stay
  BufferView<std::uint32_t> sentinel;       // as in AdamStep; a number that would not be finite stays
  std::uint32_t stamp = 0;
};

// What is behind the splats where that has been learnt (method.md 4.11): 27 numbers, by basis function and
// channel; with them a sky's state: 27 moments, and 27 second ones.
inline constexpr int kSkyNumbers = 27, kSkyState = 81;

struct DrawSky {  // image += transmittance times the colour of the sky along the pixel's direction
  ImageShape shape;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  BufferView<float> sky;            // (27)
  BufferView<float> transmittance;  // of RasterForward, which was given a black background
  BufferView<float> image;          // in/out
};

struct SkyGradient {
  ImageShape shape;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  BufferView<float> transmittance;
  BufferView<float> v_image;
  BufferView<float> gradient;  // out 27 at gradient_offset
  std::uint32_t gradient_offset = 0;
};

struct SkyStep {               // Adam; the constant colour stays within 0 and 1
  BufferView<float> state;     // (81)
  BufferView<float> gradient;  // (views, 27): added up
  std::uint32_t views = 0;
  float rate = 0, rate_harmonics = 0;  // 0: those numbers stay
  // Far above that of AdamStep: a sky that next to no light comes from is not to move.
  float epsilon = 1e-4f;
  std::uint64_t step = 1;                   // 1-based
  BufferView<std::uint32_t> sentinel = {};  // as in AdamStep; a number that would not be finite stays
  std::uint32_t stamp = 0;
};

struct Regularise {  // method.md 4.1: gradients of the parameter penalties, added to v_params
  SplatView splats;
  BufferView<float> v_params;
  PenaltyWeights weights{};
  std::uint32_t total = 0;  // splats that the means are over; 0: these
};

struct AdamStep {  // method.md 4.2
  SplatView splats;
  BufferView<float> v_params, moment1, moment2;
  BufferView<float> learning_rates;  // (parameter rows, also those that are not learnt)
  float beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-15f;
  std::uint64_t step = 1;  // 1-based, for the bias correction
  // in/out (1), or empty: not watched. Where a new value is not finite, 0 becomes `stamp` (> 0) and the
  // parameter stays as it was, while its moments become what they become. A step that finds another stamp
  // than its own changes nothing.
  BufferView<std::uint32_t> sentinel;
  std::uint32_t stamp = 0;
};

// The end of a training step, from the summed gradient of its last view on: ProjectBackward, Regularise and
// AdamStep. The same results, but v_params are undefined after it: CPUs do all in one pass and never write
// the gradient.
struct Learn {
  ProjectBackward gradient;
  Regularise penalty;
  AdamStep step;
};

struct Relocate {  // method.md 4.3 step 1; waits
  SplatView splats;
  BufferView<float> moment1, moment2;
  std::uint64_t seed = 0, iteration = 0;
};

struct Grow {        // method.md 4.3 step 2; the new splats are count .. target - 1
  SplatView splats;  // count before growth
  std::uint32_t target = 0;
  BufferView<float> moment1, moment2;
  std::uint64_t seed = 0, iteration = 0;
};

struct AddNoise {  // method.md 4.3 step 3
  SplatView splats;
  float amount = 0;  // noise_lr * lr_xyz
  std::uint64_t seed = 0, iteration = 0;
  std::uint32_t first = 0;  // number of the first of these splats, by which they draw
};

// Relocation and growth of splats that several processes share: their parts that need the device. What lies
// between, draws and copies, is that of host/train/shared_splats.cpp.
struct SamplingWeights {  // method.md 4.3: integer weights that sources are drawn by
  SplatView splats;
  bool alive_only = false;                         // 0 for the dead
  BufferView<std::uint32_t> weights, copy_counts;  // out (count): weights; 0
};
struct SplitSources {  // those with copies take their share of their opacity, and fresh moments
  SplatView splats;
  BufferView<std::uint32_t> copy_counts;
  BufferView<float> moment1, moment2;
};

// Views that several processes make together (host/pipeline/shared_renderer.hpp): a process sends the records
// of its splats that are drawn, one behind the other, each with its tile rect in the two values that a record
// has to spare, and gets their gradients in the same order.
struct PlaceDrawn {  // waits, and returns how many are drawn
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts;
  BufferView<std::uint32_t> places;  // out (count + 1): how many of the splats before are drawn
};
struct PickDrawn {
  std::uint32_t count = 0;
  BufferView<float> records;
  BufferView<std::uint32_t> tile_rects, places;
  BufferView<float> drawn;  // out (drawn, kSplatStride)
};
struct UnpackDrawn {  // where the view is drawn
  std::uint32_t count = 0;
  BufferView<float> records;  // in/out: as picked, and then as project_forward writes them
  BufferView<std::uint32_t> depth_keys, tile_rects, tile_counts;  // out
};
struct SpreadGradient {
  std::uint32_t count = 0;
  BufferView<float> drawn;  // (drawn, kGradStride)
  BufferView<std::uint32_t> places;
  BufferView<float> v_records;  // out (count, kGradStride): 0 where not drawn
};

// Any of them, for those who treat all alike: timers, recorders, whoever repeats or inspects.
using Operation =
    std::variant<ProjectForward, CountLists, BuildLists, RasterForward, ImageLoss, RasterBackward, SumSlots,
                 ProjectBackward, Regularise, AdamStep, Learn, Relocate, Grow, AddNoise, MeasureWeights,
                 CameraBackward, AppearanceStep, SamplingWeights, SplitSources, DrawSky, SkyGradient, SkyStep,
                 PlaceDrawn, PickDrawn, UnpackDrawn, SpreadGradient>;

// In the order of the variant.
inline constexpr std::array<const char*, std::variant_size_v<Operation>> kOperationNames{"project_forward",
                                                                                         "count_lists",
                                                                                         "build_lists",
                                                                                         "raster_forward",
                                                                                         "image_loss",
                                                                                         "raster_backward",
                                                                                         "sum_slots",
                                                                                         "project_backward",
                                                                                         "regularise",
                                                                                         "adam",
                                                                                         "learn",
                                                                                         "relocate",
                                                                                         "grow",
                                                                                         "add_noise",
                                                                                         "measure_weights",
                                                                                         "camera_backward",
                                                                                         "appearance_step",
                                                                                         "sampling_weights",
                                                                                         "split_sources",
                                                                                         "draw_sky",
                                                                                         "sky_gradient",
                                                                                         "sky_step",
                                                                                         "place_drawn",
                                                                                         "pick_drawn",
                                                                                         "unpack_drawn",
                                                                                         "spread_gradient"};

template <typename T, std::size_t kIndex = 0>
consteval std::size_t operation_index() {
  if constexpr (std::is_same_v<std::variant_alternative_t<kIndex, Operation>, T>)
    return kIndex;
  else
    return operation_index<T, kIndex + 1>();
}

// What an operation returns: the totals of count_lists, the number of splats that relocate moved or
// place_drawn counted, or nothing.
using Outcome = std::variant<std::monostate, ListTotals, std::uint32_t>;

template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};

// One of `cases` for each operation, of which some return nothing.
template <typename... Cases>
Outcome run_case(const Operation& operation, Cases... cases) {
  const Overloaded<Cases...> all{std::move(cases)...};
  return std::visit(
      [&](const auto& a) -> Outcome {
        if constexpr (std::is_void_v<decltype(all(a))>) {
          all(a);
          return {};
        } else {
          return all(a);
        }
      },
      operation);
}

// A back end, or stages around other stages, implements `run`; callers use the names.
class Stages {
 public:
  virtual ~Stages() = default;
  virtual const KernelConfig& config() const = 0;
  virtual Outcome run(const Operation&) = 0;

  void project_forward(const ProjectForward& a) { run(a); }
  // Waits, unless it is told where the totals go.
  ListTotals count_lists(const CountLists& a) { return std::get<ListTotals>(run(a)); }
  void build_lists(const BuildLists& a) { run(a); }
  void raster_forward(const RasterForward& a) { run(a); }
  void image_loss(const ImageLoss& a) { run(a); }
  void raster_backward(const RasterBackward& a) { run(a); }
  void sum_slots(const SumSlots& a) { run(a); }
  void project_backward(const ProjectBackward& a) { run(a); }
  void regularise(const Regularise& a) { run(a); }
  void adam(const AdamStep& a) { run(a); }
  void learn(const Learn& a) { run(a); }
  std::uint32_t relocate(const Relocate& a) { return std::get<std::uint32_t>(run(a)); }  // splats moved
  void grow(const Grow& a) { run(a); }
  void add_noise(const AddNoise& a) { run(a); }
  void measure_weights(const MeasureWeights& a) { run(a); }  // for tools
  void camera_backward(const CameraBackward& a) { run(a); }
  void appearance_step(const AppearanceStep& a) { run(a); }
  void sampling_weights(const SamplingWeights& a) { run(a); }
  void split_sources(const SplitSources& a) { run(a); }
  void draw_sky(const DrawSky& a) { run(a); }
  void sky_gradient(const SkyGradient& a) { run(a); }
  void sky_step(const SkyStep& a) { run(a); }
  std::uint32_t place_drawn(const PlaceDrawn& a) { return std::get<std::uint32_t>(run(a)); }
  void pick_drawn(const PickDrawn& a) { run(a); }
  void unpack_drawn(const UnpackDrawn& a) { run(a); }
  void spread_gradient(const SpreadGradient& a) { run(a); }
};

}  // namespace ubs
