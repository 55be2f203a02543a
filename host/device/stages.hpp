// SPDX-License-Identifier: Apache-2.0
// Stages is the upper of the two layers between the pipeline and a back end. It has the operations of the
// method. Each operation is a plain struct of views of device buffers and scalars. The pipeline and the
// trainer use only these operations. A back end may fuse or split the kernels that implement them, or choose
// between kernels, as long as the contract holds. The layouts of buffers are those of kernels/layout.h. Every
// operation is enqueued and returns at once, unless its comment says that it waits. Sums have a fixed order,
// so the same inputs give bit-identical results.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

#include "host/device/device.hpp"
#include "host/device/loss_weights.hpp"
#include "host/scene/math_mode.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs {

enum class RasterKind { cpu, gpu };  // pixel blocks with explicit vectors | one work-item per pixel

// A falloff of the user that replaces (1 - r)^beta. Expressions of r and beta in the language of kernels/
// (vreal, V(0.5), ubs_log and so on), without blanks. They are evaluated for 0 < r < support.
struct OwnFalloff {
  std::string log2;                 // log2 of the factor of the opacity
  std::string r_slope, beta_slope;  // its derivatives
  float support = 1;                // splats end at this r, the squared distance in units of the ellipse
};

// The configuration that is compiled into the kernels. Values that change between iterations are arguments
// instead.
struct KernelConfig {
  int dim = 6;  // N
  RasterKind raster = RasterKind::cpu;
  bool query_grad = false;    // the gradient includes the path through the view direction
  bool depth = false;         // the forward rasteriser also writes the expected depth
  bool depth_grad = false;    // gradients of projected splats include the depth (kGradDepth)
  bool absgrad = false;       // kGradX and kGradY sum absolute values (UBS_ABSGRAD of kernels/variant.h)
  ModelVariant variant = {};  // variant of the method; together with `dim` it determines the parameter rows
  std::optional<OwnFalloff> falloff = {};  // only with the kernel beta
  float alpha_min = 0;  // contributions with alpha <= alpha_min are skipped; 0: none are skipped
  // Enables the backward pass. Without it there are no slots and masks, and training stages are rejected.
  bool backward = true;
  std::uint32_t frozen = 0;  // parameter groups that are not trained (host/scene/frozen_groups.hpp)
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
  float eps2d = 0.3f;  // added to the diagonal of the projected support ellipse [px^2]
};

struct SplatView {  // raw parameters on the device, row k of splat i at k * stride + i
  BufferView<float> params;
  std::uint32_t count = 0, stride = 0;  // stride is a multiple of 64
};

struct ProjectForward {  // projects the splats with one camera
  SplatView splats;
  BufferView<float> cameras;  // (views, kCameraStride)
  std::uint32_t camera = 0;   // row of `cameras`
  ImageShape shape;
  ProjectionSettings settings;
  // Splat i writes row first_record + i of the outputs, which must have space for first_record + `stride`
  // splats. The rows from first_record + `count` to first_record + `stride` become undefined. Therefore
  // groups of splats must be projected in the order of their rows.
  std::uint32_t first_record = 0;
  BufferView<float> records;              // out (rows, kSplatStride); undefined for culled splats
  BufferView<std::uint32_t> depth_keys;   // out: bits of the depth, or UBS_KEY_CULLED if not visible
  BufferView<std::uint32_t> tile_rects;   // out (rows, 2): x0 | x1 << 16, y0 | y1 << 16, inclusive
  BufferView<std::uint32_t> tile_counts;  // out: number of tiles in the rectangle, 0 if not visible
};

struct ListTotals {
  std::uint64_t visible = 0;        // visible splats
  std::uint64_t intersections = 0;  // (tile, splat) pairs
};

struct CountLists {  // computes the number of intersections and the first slot of each splat
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts;
  BufferView<std::uint32_t> depth_keys;  // the same as for build_lists; a device may already start to sort
  // out (count): exclusive prefix sums of tile_counts; not written without a backward pass
  BufferView<std::uint32_t> slot_offsets;
  // out (2), or empty: the totals, visible splats first. If it is given, count_lists does not wait, and
  // returns the upper bounds `count` and `room` instead of the totals. If a view has more than `room`
  // (< 2^32) intersections, it is turned into one without splats: its tile_counts are set to 0, and all later
  // results, including its gradient, are those of an empty view.
  BufferView<std::uint64_t> totals = {};
  std::uint64_t room = 0;
};

// Builds the list of each tile, with splats ordered by (depth, index), for the view of the last count_lists.
struct BuildLists {
  std::uint32_t count = 0;
  ListTotals totals;  // result of the last count_lists
  ImageShape shape;
  BufferView<std::uint32_t> depth_keys, tile_rects, slot_offsets;
  BufferView<std::uint32_t> sorted_ids;  // out (intersections): index of the splat
  // out (intersections): slot_offsets[splat] + index of the tile in the splat's rectangle (row-major). Not
  // written without a backward pass. With RasterKind::gpu it may be empty.
  BufferView<std::uint32_t> sorted_slots;
  BufferView<std::uint32_t> tile_ranges;  // out (tiles + 1): first intersection of each tile
  bool bounded = false;                   // count_lists did not wait: `totals` are upper bounds
  // out (1), or empty: not 0 if a list has more than kLongList entries. Not written with RasterKind::cpu.
  BufferView<std::uint32_t> long_lists = {};
};

struct RasterForward {  // method.md 2.6
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  std::array<float, 3> background{0, 0, 0};
  BufferView<float> image;          // out (3, rows, pitch), not clamped
  BufferView<float> transmittance;  // out (rows, pitch): transmittance after the last splat, 1 - alpha
  BufferView<float> depth;          // out (rows, pitch): expected depth; only with KernelConfig::depth
  // out (intersections), indexed by SLOT: the 4x4 pixel blocks of the tile that the splat may affect, as bits
  // 4 by + bx. These are the blocks that the splat reaches while they are open; they include at least all
  // blocks in which it is composited or finishes a pixel. 0: the splat contributes nothing to the tile. Not
  // written without a backward pass. With RasterKind::gpu it may be empty.
  BufferView<std::uint16_t> masks;
  // out, list_state_floats(intersections) of stage_sizes.hpp: the pixels in front of the segments of lists
  // (kernels/gpu/list_segments.h). Empty for RasterKind::cpu, without a backward pass, and if masks is empty.
  BufferView<float> states;
  BufferView<std::uint32_t> long_lists = {};  // from BuildLists; empty: long lists are not divided
};

// Gradient slots of slot_floats() floats each (stage_sizes.hpp). They are in a single buffer if one
// allocation of the device is large enough. Otherwise they are in several pieces: slot s is in piece
// s >> bits at index s modulo 2^bits.
struct SlotViews {
  static constexpr unsigned kMaxPieces = 8;
  std::array<BufferView<float>, kMaxPieces> pieces = {};
  unsigned count = 0, bits = 32;
};

struct RasterBackward {  // method.md 3.1; needs the outputs of RasterForward for the same lists
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  BufferView<float> image;
  BufferView<std::uint16_t> masks;
  BufferView<float> states;
  BufferView<float> v_image;  // (3, rows, pitch); 0 outside width x height
  SlotViews slots;            // out, one per intersection; slots with mask 0 may stay unwritten
};

struct SumSlots {  // adds the slots with mask != 0 of each splat, in a fixed order
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts, slot_offsets;
  SlotViews slots;
  BufferView<std::uint16_t> masks;
  // Records of the splats. If a factor is the same in all slots of a splat, a rasteriser may leave the
  // multiplication with it to this stage.
  BufferView<float> records;
  // out (count, kGradStride), 0 after kGradB; 0 for splats without contribution
  BufferView<float> v_records;
};

// Gradients and moments have only the rows of the trained parameters, in the same order
// (KernelConfig::frozen).
struct ProjectBackward {  // from the gradient of projected splats to that of the raw parameters
  SplatView splats;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  ImageShape shape;
  ProjectionSettings settings;
  std::uint32_t first_record = 0;  // as in ProjectForward
  BufferView<float> v_records;
  BufferView<float> v_params;  // in/out (trained rows, stride)
  bool accumulate = false;     // add to v_params (later views of a batch) instead of overwriting it
};

// Computes the gradient of the camera from that of the projected splats. It always includes the path through
// the view direction, regardless of KernelConfig::query_grad. The result consists of partial sums in a fixed
// order, which the host adds. KernelConfig::frozen must be 0.
struct CameraBackward {
  ProjectBackward gradient;    // without v_params and accumulate
  BufferView<float> v_camera;  // out (kCameraGrads, lanes)
  std::uint32_t lanes = 0;     // a multiple of 64
};

// Measures how much the splats of a forward pass affect its pixels (kernels/opencl/weights.cl).
struct MeasureWeights {
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  BufferView<std::uint16_t> masks;
  BufferView<float> weights;  // out (intersections) by slot: maximum of transmittance * alpha in the tile
};

struct ImageLoss {  // weighted sum of mean|I - T| and 1 - SSIM (method.md 4.1) and its gradient
  ImageShape shape;
  BufferView<float> image;          // (3, rows, pitch)
  BufferView<std::uint8_t> target;  // (3, height, width) planar 8 bit: value / 255; or
  BufferView<float> target_float;   // (3, height, width) when `target` is empty
  // Pixels whose mask is 0 are treated as if they were outside the image: they and the windows around them do
  // not count, they are zero (image and target) in other windows, and their gradient is 0. Means are over the
  // pixels that count.
  BufferView<std::uint8_t> mask;  // (height, width); empty: all pixels count
  std::uint32_t counted = 0;      // with a mask: number of pixels that count
  LossWeights weights{0.8f, 0.2f};
  float scale = 1;            // of the gradient: 1 / batch size
  bool clamp = false;         // for evaluation: clamp the image to [0, 1] first
  BufferView<float> v_image;  // out (3, rows, pitch), 0 outside the image; may be empty
  BufferView<float> sums;     // out 8 floats at sums_offset: mean|I-T|, mean SSIM, mse r, g, b, 0, 0, 0
  std::uint32_t sums_offset = 0;
  // Exposure and white balance of the photograph: 12 numbers (kernels/math/appearance.h) with which the image
  // is mapped before it is compared. v_image is the gradient of the image before the mapping. Empty: no
  // mapping.
  BufferView<float> appearance = {};
  std::uint32_t appearance_offset = 0;
  BufferView<float> v_appearance = {};  // out 12 numbers, if v_image is given
  std::uint32_t v_appearance_offset = 0;
};
inline constexpr int kAppearanceNumbers = 12, kAppearanceState = 60;  // kernels/math/appearance.h

// Takes an Adam step of the numbers of one image, and then subtracts the mean over all images.
struct AppearanceStep {
  BufferView<float> state;  // (images, 60): numbers, two moments, two bias corrections
  std::uint32_t images = 0, image = 0;
  BufferView<float> gradient;  // 12 at gradient_offset
  std::uint32_t gradient_offset = 0;
  float rate_diagonal = 0, rate_other = 0;  // 0: these numbers are not changed
  BufferView<std::uint32_t> sentinel;       // as in AdamStep; results that are not finite are not stored
  std::uint32_t stamp = 0;
};

// A learnt background (sky) behind the splats (method.md 4.11) has 27 numbers, by basis function and channel.
// Its state consists of these numbers, 27 first moments and 27 second moments.
inline constexpr int kSkyNumbers = 27, kSkyState = 81;

struct DrawSky {  // image += transmittance * colour of the sky in the direction of the pixel
  ImageShape shape;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  BufferView<float> sky;            // (27)
  BufferView<float> transmittance;  // of RasterForward with a black background
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

struct SkyStep {               // Adam; the constant colour is kept within [0, 1]
  BufferView<float> state;     // (81)
  BufferView<float> gradient;  // (views, 27): added by this stage
  std::uint32_t views = 0;
  float rate = 0, rate_harmonics = 0;  // 0: these numbers are not changed
  // This value is far larger than in AdamStep, so that a sky that is hardly visible does not change.
  float epsilon = 1e-4f;
  std::uint64_t step = 1;                   // 1-based
  BufferView<std::uint32_t> sentinel = {};  // as in AdamStep; results that are not finite are not stored
  std::uint32_t stamp = 0;
};

struct Regularise {  // method.md 4.1: gradients of the parameter penalties, added to v_params
  SplatView splats;
  BufferView<float> v_params;
  PenaltyWeights weights{};
  std::uint32_t total = 0;  // number of splats that the means are over; 0: the splats passed here
};

struct AdamStep {  // method.md 4.2
  SplatView splats;
  BufferView<float> v_params, moment1, moment2;
  BufferView<float> learning_rates;  // (parameter rows, including those that are not trained)
  float beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-15f;
  std::uint64_t step = 1;  // 1-based, for the bias correction
  // in/out (1), or empty: no check. If a new value is not finite, the sentinel changes from 0 to `stamp`,
  // which must be above 0. The parameter keeps its old value, while its moments are updated. A step that
  // finds the stamp of another step changes nothing.
  BufferView<std::uint32_t> sentinel;
  std::uint32_t stamp = 0;
};

// The last stages of a training step, starting from the summed gradient of its last view: ProjectBackward,
// Regularise and AdamStep. The results are those of the three stages, except that v_params are undefined
// afterwards, because CPUs do everything in one pass and never write the gradient.
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
  std::uint32_t first = 0;  // index of the first of these splats; the random numbers depend on it
};

// The parts of relocation and growth that run on the device if several processes share the splats. The steps
// in between, which draw the sources and copy splats, are in host/train/shared_splats.cpp.
struct SamplingWeights {  // method.md 4.3: integer weights with which sources are drawn
  SplatView splats;
  bool alive_only = false;                         // dead splats get weight 0
  BufferView<std::uint32_t> weights, copy_counts;  // out (count): the weights; copy_counts become 0
};
struct SplitSources {  // divides the opacity of sources with copies; resets their moments
  SplatView splats;
  BufferView<std::uint32_t> copy_counts;
  BufferView<float> moment1, moment2;
};

// Views that several processes render together (host/pipeline/shared_renderer.hpp). Each process sends the
// records of its visible splats, one after the other. Each record contains the tile rectangle in two values
// that are otherwise unused. The process receives the gradients of these splats in the same order.
struct PlaceDrawn {  // waits, and returns the number of visible splats
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts;
  BufferView<std::uint32_t> places;  // out (count + 1): number of visible splats before each splat
};
struct PickDrawn {
  std::uint32_t count = 0;
  BufferView<float> records;
  BufferView<std::uint32_t> tile_rects, places;
  BufferView<float> drawn;  // out (visible splats, kSplatStride)
};
struct UnpackDrawn {  // on the process that renders the view
  std::uint32_t count = 0;
  BufferView<float> records;  // in/out: as from PickDrawn, then as from ProjectForward
  BufferView<std::uint32_t> depth_keys, tile_rects, tile_counts;  // out
};
struct SpreadGradient {
  std::uint32_t count = 0;
  BufferView<float> drawn;  // (visible splats, kGradStride)
  BufferView<std::uint32_t> places;
  BufferView<float> v_records;  // out (count, kGradStride): 0 for splats that are not visible
};

// Any of the operations, for code that treats all of them alike, such as timers and recorders.
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

// The result of an operation: the totals of count_lists, the number of splats that relocate moved or
// place_drawn counted, or nothing.
using Outcome = std::variant<std::monostate, ListTotals, std::uint32_t>;

template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};

// Calls the case for the type of the operation. Cases may return nothing.
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

// Back ends implement `run`, and so do classes that wrap other stages. Callers use the named functions below.
class Stages {
 public:
  virtual ~Stages() = default;
  virtual const KernelConfig& config() const = 0;
  virtual Outcome run(const Operation&) = 0;

  void project_forward(const ProjectForward& a) { run(a); }
  // Waits, unless `totals` is given.
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
