// SPDX-License-Identifier: Apache-2.0
// Stages is the upper one of the two layers between the pipeline and a back end; the lower one is Device
// (device.hpp). Stages runs the operations of the method. Each operation is described by a plain struct,
// which contains views of device buffers and scalars. The pipeline and the trainer use only these operations.
// A back end may implement an operation with one or several kernels, combine operations in one kernel, or
// choose between kernels, as long as the results are those that this file describes. kernels/layout.h
// describes the layouts of buffers. Every operation is enqueued and returns at once, unless its comment says
// that it waits. Sums are computed in a fixed order, so the same inputs give bit-identical results.
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

// The rasteriser `cpu` processes blocks of pixels with explicit vectors; `gpu` uses one work-item per pixel.
enum class RasterKind { cpu, gpu };

// OwnFalloff is a user-defined falloff that replaces (1 - r)^beta. It consists of expressions of r and beta
// that the kernels can contain (with vreal, V(0.5), ubs_log and so on), without blanks. They are evaluated
// for 0 < r < support, where r is the squared distance from the centre in units of the ellipse.
struct OwnFalloff {
  std::string log2;                 // binary logarithm of the factor that the opacity is multiplied by
  std::string r_slope, beta_slope;  // derivatives of `log2` with respect to r and beta
  float support = 1;                // splats end at this value of r
};

// KernelConfig is the configuration that is compiled into the kernels. Values that change between iterations
// are arguments of the kernels instead.
struct KernelConfig {
  int dim = 6;  // N
  RasterKind raster = RasterKind::cpu;
  bool query_grad = false;    // the gradient includes the path through the view direction
  bool depth = false;         // the forward rasteriser also writes the expected depth
  bool depth_grad = false;    // gradients of projected splats include the depth (kGradDepth)
  bool absgrad = false;       // kGradX and kGradY are sums of absolute values (UBS_ABSGRAD)
  ModelVariant variant = {};  // variant of the method; together with `dim` it determines the parameter rows
  std::optional<OwnFalloff> falloff = {};  // requires a spatial kernel with beta
  float alpha_min = 0;  // contributions with alpha <= alpha_min are skipped; if it is 0, none are skipped
  // Enables the backward pass. If it is false, slots and masks are not computed, and the operations that need
  // gradients throw an error.
  bool backward = true;
  std::uint32_t frozen = 0;  // parameter groups that are not trained (host/scene/frozen_groups.hpp)
  // The splats are 3D Gaussians with quaternions, and harmonics or plain colours, whose values are in arrays
  // of the program: SplatView.params and ProjectBackward.v_params each contain one GaussianArrays. There are
  // no stages that change parameters, no frozen groups, and gradients are not accumulated.
  bool gaussian_arrays = false;
  MathMode math = MathMode::exact;
};

// ImageShape is the size of an image. Its planes are padded to whole tiles of kTileSide pixels
// (kernels/layout.h).
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

// GaussianArrays contains the addresses, in the memory of the device, of arrays that belong to the program:
// means (count, 3), quats (count, 4) with w first, scales (count, 3), opacities (count), and colours (count,
// bases, 3), which are coefficients of spherical harmonics unless the model has plain colours. Scales and
// opacities are those that are rendered, not raw parameters. kernels/map/arrays.h has a struct with the same
// name and layout.
struct GaussianArrays {
  float *means = nullptr, *quats = nullptr, *scales = nullptr, *opacities = nullptr, *colours = nullptr;
  std::uint32_t bases = 0, unused = 0;
};

// SplatView refers to the raw parameters of splats on the device. Parameter k of splat i is at index
// k * stride + i.
struct SplatView {
  BufferView<float> params;
  std::uint32_t count = 0, stride = 0;  // stride is a multiple of 64
};

// Projects the splats into the view of one camera.
struct ProjectForward {
  SplatView splats;
  BufferView<float> cameras;  // (views, kCameraStride)
  std::uint32_t camera = 0;   // row of `cameras`
  ImageShape shape;
  ProjectionSettings settings;
  // The outputs of splat i are stored in row first_record + i. The outputs must have first_record + stride
  // rows. The rows from first_record + count on become undefined. Therefore groups of splats must be
  // projected in the order of their rows.
  std::uint32_t first_record = 0;
  BufferView<float> records;             // out (rows, kSplatStride); undefined for culled splats
  BufferView<std::uint32_t> depth_keys;  // out: bits of the depth, or UBS_KEY_CULLED if not visible
  // out (rows, 2): the first and last column of the tiles as x0 | x1 << 16, and their rows as y0 | y1 << 16
  BufferView<std::uint32_t> tile_rects;
  BufferView<std::uint32_t> tile_counts;  // out: number of tiles in the rectangle, 0 if not visible
};

struct ListTotals {
  std::uint64_t visible = 0;        // visible splats
  std::uint64_t intersections = 0;  // (tile, splat) pairs
};

// Computes the number of intersections and the first slot of each splat. Waits, unless `totals` is not empty.
struct CountLists {
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts;
  BufferView<std::uint32_t> depth_keys;  // the same as in BuildLists, because a device may start to sort here
  // out (count): exclusive prefix sums of tile_counts. Not written without a backward pass.
  BufferView<std::uint32_t> slot_offsets;
  // out (2), or empty: number of visible splats, and number of intersections. If this buffer is not empty,
  // the operation does not wait, and returns the upper bounds `room` instead of these totals. If a view has
  // more visible splats than room.visible (<= count), or more intersections than room.intersections (< 2^32),
  // it is treated as a view without splats: tile_counts are set to 0, and all later results, including the
  // gradient, are those of an empty view.
  BufferView<std::uint64_t> totals = {};
  ListTotals room = {};
};

// Builds the list of each tile for the view of the last CountLists. The splats of a list are ordered by
// depth, and by index if the depths are equal.
struct BuildLists {
  std::uint32_t count = 0;
  ListTotals totals;  // result of the last CountLists
  ImageShape shape;
  BufferView<std::uint32_t> depth_keys, tile_rects, slot_offsets;
  BufferView<std::uint32_t> sorted_ids;  // out (intersections): index of the splat
  // out (intersections): slot of the intersection, which is slot_offsets[splat] plus the row-major index of
  // the tile in the rectangle of the splat. Not written without a backward pass. With RasterKind::gpu it may
  // be empty.
  BufferView<std::uint32_t> sorted_slots;
  BufferView<std::uint32_t> tile_ranges;  // out (tiles + 1): first intersection of each tile
  bool bounded = false;                   // CountLists did not wait, so `totals` are upper bounds
  // out (1), or empty: 0 if all lists have at most kLongList entries, otherwise another number. Not written
  // with RasterKind::cpu.
  BufferView<std::uint32_t> long_lists = {};
};

// Renders the lists to an image (docs/method.md, section 2.6).
struct RasterForward {
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  std::array<float, 3> background{0, 0, 0};
  BufferView<float> image;          // out (3, rows, pitch), not clamped
  BufferView<float> transmittance;  // out (rows, pitch): transmittance of all splats together, 1 - alpha
  BufferView<float> depth;          // out (rows, pitch): expected depth; only with KernelConfig::depth
  // out (intersections), indexed by slot: the blocks of 4 x 4 pixels of the tile that the splat may affect.
  // Bit 4 by + bx stands for the block in row by and column bx. The bits of all blocks are set in which the
  // splat is composited, or in which a pixel closes at this splat; further bits may be set too. If the mask
  // is 0, the splat contributes nothing to the tile. Not written without a backward pass. With
  // RasterKind::gpu it may be empty.
  BufferView<std::uint16_t> masks;
  // out: the states of the pixels in front of each segment of a list (kernels/gpu/list_segments.h). The size
  // is list_state_floats(intersections) of stage_sizes.hpp. Empty with RasterKind::cpu, without a backward
  // pass, and if `masks` is empty.
  BufferView<float> states;
  BufferView<std::uint32_t> long_lists = {};  // from BuildLists; if it is empty, long lists are not divided
};

// SlotViews contains the gradient slots, each of which has slot_floats() floats (stage_sizes.hpp). They are
// in a single buffer, unless this is larger than the largest allocation of the device. In this case they are
// in several buffers: slot s is in pieces[s >> bits], at index s modulo 2^bits.
struct SlotViews {
  static constexpr unsigned kMaxPieces = 8;
  std::array<BufferView<float>, kMaxPieces> pieces = {};
  unsigned count = 0, bits = 32;
};

// Computes the gradient of the projected splats from the gradient of the image (docs/method.md, section 3.1).
// Its inputs include the outputs of RasterForward for the same lists.
struct RasterBackward {
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  BufferView<float> image;
  BufferView<std::uint16_t> masks;
  BufferView<float> states;
  BufferView<float> v_image;  // (3, rows, pitch); 0 outside width x height
  SlotViews slots;            // out, one per intersection; slots whose mask is 0 may stay unwritten
  // Only with KernelConfig::absgrad: the number of channels in addition to red, green and blue, and the
  // values of the splats in these channels (splats, more_channels). v_more has the shape (1 + more_channels,
  // rows, pitch). Its first plane is the sum of image * v over these channels, and the other planes are v,
  // the gradients with respect to the channels of the image. There is no gradient with respect to
  // more_colours.
  BufferView<float> more_colours = {}, v_more = {};
  int more_channels = 0;
};

// Adds the slots of each splat whose mask is not 0, in a fixed order.
struct SumSlots {
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts, slot_offsets;
  SlotViews slots;
  BufferView<std::uint16_t> masks;
  // Records of the splats. If the gradients in all slots of a splat have a common factor, the rasteriser may
  // omit this factor. Then this operation computes the factor from the record and multiplies the sum by it.
  BufferView<float> records;
  // out (count, kGradStride). The values after kGradB are 0, and so are all values of splats that contribute
  // nothing.
  BufferView<float> v_records;
};

// Computes the gradient of the raw parameters from the gradient of the projected splats. Buffers of parameter
// gradients and moments have only the rows of trained parameters (see KernelConfig::frozen), in the order of
// the parameters.
struct ProjectBackward {
  SplatView splats;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  ImageShape shape;
  ProjectionSettings settings;
  std::uint32_t first_record = 0;  // row of `v_records` that belongs to splat 0, as in ProjectForward
  BufferView<float> v_records;
  BufferView<float> v_params;  // in/out (trained rows, stride)
  bool accumulate = false;     // add to v_params instead of overwriting it, for later views of a batch
};

// Computes the gradient of the camera from the gradient of the projected splats. It always includes the path
// through the view direction, even if KernelConfig::query_grad is false. The result consists of partial sums,
// which the host adds in a fixed order. KernelConfig::frozen must be 0.
struct CameraBackward {
  ProjectBackward gradient;    // v_params and accumulate are not used
  BufferView<float> v_camera;  // out (kCameraGrads, lanes)
  std::uint32_t lanes = 0;     // number of partial sums of each value, a multiple of 64
};

// Measures how much the splats of a forward pass contribute to its pixels (kernels/opencl/weights.cl).
struct MeasureWeights {
  ImageShape shape;
  BufferView<float> records;
  BufferView<std::uint32_t> sorted_ids, sorted_slots, tile_ranges;
  BufferView<std::uint16_t> masks;
  // out (intersections), indexed by slot: maximum of transmittance * alpha of the splat over the pixels of
  // the tile
  BufferView<float> weights;
};

// Computes the loss of an image I compared with a target image T, and the gradient of the loss. The loss is a
// weighted sum of mean |I - T| and 1 - SSIM (docs/method.md, section 4.1).
struct ImageLoss {
  ImageShape shape;
  BufferView<float> image;  // (3, rows, pitch)
  // The target image (3, height, width) is in one of these two buffers, and the other one is empty. 8-bit
  // values are divided by 255.
  BufferView<std::uint8_t> target;
  BufferView<float> target_float;
  // Pixels whose mask is 0 are treated as if they were outside of the image. The pixels and the windows
  // around them are not part of any mean, the pixels are zero in the windows around other pixels (in the
  // image and in the target), and their gradient is 0. If the mask is empty, all pixels are used.
  BufferView<std::uint8_t> mask;  // (height, width)
  std::uint32_t counted = 0;      // number of pixels whose mask is not 0; only used with a mask
  LossWeights weights = loss_weights(0.2f);
  float scale = 1;     // factor of the gradient: 1 / batch size
  bool clamp = false;  // clamp the image to [0, 1] first, for evaluations
  // out (3, rows, pitch), 0 outside of the image. If it is empty, no gradient is computed.
  BufferView<float> v_image;
  // out, 8 floats at sums_offset: mean |I - T|, mean SSIM, the mean squared errors of red, green and blue, 0,
  // 0, 0
  BufferView<float> sums;
  std::uint32_t sums_offset = 0;
  // 12 numbers that describe the exposure and the white balance of the photograph
  // (kernels/math/appearance.h). The colours of the image are mapped with these numbers before the image is
  // compared, and v_image is the gradient with respect to the image before the mapping. If the view is empty,
  // there is no mapping.
  BufferView<float> appearance = {};
  std::uint32_t appearance_offset = 0;
  BufferView<float> v_appearance = {};  // out (12) at v_appearance_offset, if v_image is not empty
  std::uint32_t v_appearance_offset = 0;
};
inline constexpr int kAppearanceNumbers = 12, kAppearanceState = 60;  // kernels/math/appearance.h

// Runs an Adam step for the appearance numbers of one image, and then subtracts the mean over all images.
struct AppearanceStep {
  BufferView<float> state;  // (images, 60): 12 numbers with their two moments and two bias corrections
  std::uint32_t images = 0, image = 0;
  BufferView<float> gradient;  // (12) at gradient_offset
  std::uint32_t gradient_offset = 0;
  // Learning rates of the diagonal elements of the colour matrix, and of the other numbers. Numbers with the
  // rate 0 do not change.
  float rate_diagonal = 0, rate_other = 0;
  BufferView<std::uint32_t> sentinel;  // as in AdamStep; results that are not finite are not stored
  std::uint32_t stamp = 0;
};

// A trained sky behind the splats (docs/method.md, section 4.11) has 27 numbers: 9 basis functions with 3
// channels each. Its state consists of these numbers, 27 first moments and 27 second moments.
inline constexpr int kSkyNumbers = 27, kSkyState = 81;

// Adds the sky to an image: image += transmittance * colour of the sky in the direction of the pixel.
struct DrawSky {
  ImageShape shape;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  BufferView<float> sky;            // (27)
  BufferView<float> transmittance;  // output of RasterForward, which must have used a black background
  BufferView<float> image;          // in/out
};

// Computes the gradient of the numbers of the sky from the gradient of the image.
struct SkyGradient {
  ImageShape shape;
  BufferView<float> cameras;
  std::uint32_t camera = 0;
  BufferView<float> transmittance;
  BufferView<float> v_image;
  BufferView<float> gradient;  // out (27) at gradient_offset
  std::uint32_t gradient_offset = 0;
};

// Runs an Adam step for the numbers of the sky. The mean colour is clamped to [0, 1].
struct SkyStep {
  BufferView<float> state;     // (81)
  BufferView<float> gradient;  // (views, 27); the step uses the sum over the views
  std::uint32_t views = 0;
  // Learning rates of the mean colour and of the other numbers. Numbers with the rate 0 do not change.
  float rate = 0, rate_harmonics = 0;
  // This value is far larger than in AdamStep, so that a sky that is hardly visible does not change.
  float epsilon = 1e-4f;
  std::uint64_t step = 1;                   // number of the step, from 1 on
  BufferView<std::uint32_t> sentinel = {};  // as in AdamStep; results that are not finite are not stored
  std::uint32_t stamp = 0;
};

// Adds the gradients of the penalties of parameters to v_params (docs/method.md, section 4.1).
struct Regularise {
  SplatView splats;
  BufferView<float> v_params;
  PenaltyWeights weights{};  // 0: no penalty
  // Number of splats that the means are computed over. If it is 0, splats.count is used.
  std::uint32_t total = 0;
};

// Runs a step of the optimiser Adam (docs/method.md, section 4.2).
struct AdamStep {
  SplatView splats;
  BufferView<float> v_params, moment1, moment2;
  BufferView<float> learning_rates;  // (parameter rows, including those that are not trained)
  float beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-15f;
  std::uint64_t step = 1;  // number of the step, from 1 on, for the bias correction
  // in/out (1), or empty. If it is empty, new values are not checked. Otherwise, if a new value is not
  // finite, the sentinel changes from 0 to `stamp`, which must be above 0. In this case the parameter keeps
  // its old value, but its moments are updated. If the sentinel contains the stamp of another step, the step
  // changes nothing.
  BufferView<std::uint32_t> sentinel;
  std::uint32_t stamp = 0;
};

// Runs the last operations of a training step: ProjectBackward for its last view, Regularise and AdamStep.
// The results are those of the three operations, except that v_params are undefined afterwards. The reason is
// that CPUs run the three operations in one pass over the splats and never store the gradient.
struct Learn {
  ProjectBackward gradient;
  Regularise penalty;
  AdamStep step;
};

// Moves dead splats to the positions of other splats (docs/method.md, section 4.3, step 1). Waits.
struct Relocate {
  SplatView splats;
  BufferView<float> moment1, moment2;
  std::uint64_t seed = 0, iteration = 0;
  float spread = 0;  // the setting copy_spread; 0: copies are equal to their sources
};

// Adds the splats count to target - 1 as copies of other splats (docs/method.md, section 4.3, step 2).
struct Grow {
  SplatView splats;  // `count` is the number of splats before the growth
  std::uint32_t target = 0;
  BufferView<float> moment1, moment2;
  std::uint64_t seed = 0, iteration = 0;
  float spread = 0;  // as in Relocate
};

// Adds noise to the positions of the splats (docs/method.md, section 4.3, step 3).
struct AddNoise {
  SplatView splats;
  float amount = 0;  // noise_lr * lr_xyz
  std::uint64_t seed = 0, iteration = 0;
  std::uint32_t first = 0;  // index in the whole model of the first splat; the random numbers depend on it
};

// SamplingWeights, SplitSources and PlaceCopies are the parts of relocation and growth that run on the device
// if several processes share the splats. The other parts, which choose the splats to copy (sources) and copy
// them, are in host/train/shared_splats.cpp.

// Computes integer weights that are proportional to the probability with which a splat is chosen as a source
// (docs/method.md, section 4.3).
struct SamplingWeights {
  SplatView splats;
  bool alive_only = false;                         // dead splats get the weight 0
  BufferView<std::uint32_t> weights, copy_counts;  // out (count): the weights, and zeros in copy_counts
};
// Divides the opacity of each source between the source and its copies, reduces its size if `spread` is not
// 0, and resets its moments.
struct SplitSources {
  SplatView splats;
  BufferView<std::uint32_t> copy_counts;
  BufferView<float> moment1, moment2;
  float spread = 0;
};
// Displaces copies by random vectors.
struct PlaceCopies {
  SplatView splats;
  std::uint32_t first = 0, slots = 0;  // the splats first to first + slots - 1
  BufferView<std::uint32_t> sources;   // (slots): UBS_NO_SOURCE for a splat that is not a copy
  float spread = 0;
  std::uint32_t purpose = 0;  // kDrawRelocate or kDrawGrow
  std::uint64_t seed = 0, iteration = 0;
  std::uint32_t first_number = 0;  // number of the first slot; the random numbers depend on it
};

// The next four operations convert gradients with respect to alpha and depth into gradients with respect to
// colours, which RasterBackward computes with. host/pipeline/image_gradient.hpp explains the method. All
// images have the layout of RasterForward: (rows, pitch), or (3, rows, pitch).

// Changes one channel of each pixel of `image` whose v_alpha is not 0, so that RasterBackward computes the
// gradient of colours and alpha. If v_image is 0 or nearly 0 in all channels of such a pixel, one of them is
// changed, too.
struct AlphaToColours {
  ImageShape shape;
  BufferView<float> v_alpha, transmittance;
  BufferView<float> image, v_image;  // in/out
};
// Replaces the colours of the projected splats by (z - z0, 1, 0). z is the depth of the splat. z0 is the mean
// depth of the pixels whose depth has a gradient.
struct DepthToRecords {
  ImageShape shape;
  BufferView<float> depth, v_depth;
  std::uint32_t count = 0;
  BufferView<float> mean;     // out (1): z0
  BufferView<float> records;  // in/out (count, kSplatStride)
};
// Replaces `image`, which RasterForward has rendered from the result of DepthToRecords on a black background,
// and v_image, so that the next RasterBackward and SumSlots compute the gradient of depth as if it were a
// colour.
struct DepthToImage {
  ImageShape shape;
  BufferView<float> depth, v_depth;
  BufferView<float> mean;     // output of DepthToRecords
  BufferView<float> image;    // in/out
  BufferView<float> v_image;  // out
};
// Moves the gradient of this colour in v_records to the depths of the splats, and adds `earlier`, the
// gradient of the projected splats that comes from colours and alpha.
struct DepthFromRecords {
  std::uint32_t count = 0;
  BufferView<float> earlier;    // (count, kGradStride), or empty
  BufferView<float> v_records;  // in/out (count, kGradStride)
};

// The next four operations serve views that several processes render together
// (host/pipeline/shared_renderer.hpp). Each process sends the records of its visible splats, one after the
// other, to the process that renders the view. Each record contains the tile rectangle in two values that are
// otherwise unused. The process receives the gradients of these splats in the same order.

// Computes the place of each visible splat among the visible splats. Waits, and returns the number of visible
// splats.
struct PlaceDrawn {
  std::uint32_t count = 0;
  BufferView<std::uint32_t> tile_counts;
  BufferView<std::uint32_t> places;  // out (count + 1): number of visible splats before each splat
};
// Copies the records of the visible splats to the places of PlaceDrawn.
struct PickDrawn {
  std::uint32_t count = 0;
  BufferView<float> records;
  BufferView<std::uint32_t> tile_rects, places;
  BufferView<float> drawn;  // out (visible splats, kSplatStride)
};
// Converts records of PickDrawn to the outputs of ProjectForward, on the process that renders the view.
struct UnpackDrawn {
  std::uint32_t count = 0;
  BufferView<float> records;  // in: as PickDrawn writes them; out: as ProjectForward writes them
  BufferView<std::uint32_t> depth_keys, tile_rects, tile_counts;  // out
};
// Copies the gradients of the visible splats back to the rows of these splats.
struct SpreadGradient {
  std::uint32_t count = 0;
  BufferView<float> drawn;  // (visible splats, kGradStride)
  BufferView<std::uint32_t> places;
  BufferView<float> v_records;  // out (count, kGradStride): 0 for splats that are not visible
};

// An Operation is any one of the operations. It is for code that handles all operations in the same way, for
// example code that measures their time.
using Operation =
    std::variant<ProjectForward, CountLists, BuildLists, RasterForward, ImageLoss, RasterBackward, SumSlots,
                 ProjectBackward, Regularise, AdamStep, Learn, Relocate, Grow, AddNoise, MeasureWeights,
                 CameraBackward, AppearanceStep, SamplingWeights, SplitSources, PlaceCopies, DrawSky,
                 SkyGradient, SkyStep, AlphaToColours, DepthToRecords, DepthToImage, DepthFromRecords,
                 PlaceDrawn, PickDrawn, UnpackDrawn, SpreadGradient>;

// Names of the operations, in the order of the types of Operation.
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
                                                                                         "place_copies",
                                                                                         "draw_sky",
                                                                                         "sky_gradient",
                                                                                         "sky_step",
                                                                                         "alpha_to_colours",
                                                                                         "depth_to_records",
                                                                                         "depth_to_image",
                                                                                         "depth_from_records",
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

// Outcome is the result of an operation: the totals of CountLists, the number of splats that Relocate has
// moved or PlaceDrawn has counted, or nothing for all other operations.
using Outcome = std::variant<std::monostate, ListTotals, std::uint32_t>;

template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};

// Calls the one of the functions `cases` that accepts the type of the operation, and returns its result. The
// functions may return nothing.
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

// Back ends implement run(), and so do classes that add something to the stages of a back end. Callers use
// the named functions instead of run().
class Stages {
 public:
  virtual ~Stages() = default;
  virtual const KernelConfig& config() const = 0;
  virtual Outcome run(const Operation&) = 0;

  void project_forward(const ProjectForward& a) { run(a); }
  // Waits, unless CountLists::totals is not empty.
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
  // Returns the number of splats that were moved.
  std::uint32_t relocate(const Relocate& a) { return std::get<std::uint32_t>(run(a)); }
  void grow(const Grow& a) { run(a); }
  void add_noise(const AddNoise& a) { run(a); }
  void measure_weights(const MeasureWeights& a) { run(a); }
  void camera_backward(const CameraBackward& a) { run(a); }
  void appearance_step(const AppearanceStep& a) { run(a); }
  void sampling_weights(const SamplingWeights& a) { run(a); }
  void split_sources(const SplitSources& a) { run(a); }
  void place_copies(const PlaceCopies& a) { run(a); }
  void draw_sky(const DrawSky& a) { run(a); }
  void sky_gradient(const SkyGradient& a) { run(a); }
  void sky_step(const SkyStep& a) { run(a); }
  void alpha_to_colours(const AlphaToColours& a) { run(a); }
  void depth_to_records(const DepthToRecords& a) { run(a); }
  void depth_to_image(const DepthToImage& a) { run(a); }
  void depth_from_records(const DepthFromRecords& a) { run(a); }
  // Returns the number of visible splats.
  std::uint32_t place_drawn(const PlaceDrawn& a) { return std::get<std::uint32_t>(run(a)); }
  void pick_drawn(const PickDrawn& a) { run(a); }
  void unpack_drawn(const UnpackDrawn& a) { run(a); }
  void spread_gradient(const SpreadGradient& a) { run(a); }
};

}  // namespace ubs
