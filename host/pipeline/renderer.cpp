// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/renderer.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#ifdef __SSE2__
#include <immintrin.h>
#endif

#include "host/base/error.hpp"
#include "host/device/stage_sizes.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

// Number of partial sums of the camera gradient. This many sums occupy a large GPU completely and take half a
// megabyte.
constexpr std::uint32_t kCameraLanes = 8192;
constexpr std::size_t kMaxTilesAcross = 65535;  // a tile coordinate is packed into 16 bits

std::vector<float> camera_record(const Camera& camera) {
  std::vector<float> record(kCameraStride, 0.0f);
  const auto put = [&](std::size_t at, double value) { record[at] = static_cast<float>(value); };
  for (std::size_t i = 0; i < 9; ++i) put(kCameraRotation + i, camera.rotation[i]);
  const std::array<double, 3> centre = camera.centre();
  for (std::size_t i = 0; i < 3; ++i) put(kCameraCentre + i, centre[i]);
  put(kCameraFocal, camera.fx);
  put(kCameraFocal + 1, camera.fy);
  put(kCameraPrincipal, camera.cx);
  put(kCameraPrincipal + 1, camera.cy);
  put(kCameraSize, camera.width);
  put(kCameraSize + 1, camera.height);
  put(kCameraQuery, camera.time);
  for (std::size_t i = 0; i < camera.extra.size() && i + 1 < kCameraQueryMax; ++i)
    put(kCameraQuery + 1 + i, camera.extra[i]);
  return record;
}

using FourFloats = float __attribute__((vector_size(16)));

FourFloats load_four(const float* from) {
  FourFloats four;
  std::memcpy(&four, from, sizeof four);
  return four;
}

// Writes to memory without using the caches, because a cached store would first read the cache line that it
// replaces. The address `to` must be a multiple of 16.
void store_four(const FourFloats& four, float* to) {
#ifdef __SSE2__
  _mm_stream_ps(to, four);
#else
  std::memcpy(to, &four, sizeof four);
#endif
}

// Converts four pixels of three planes to interleaved RGB. It uses shuffles, because GCC compiles a plain
// loop to code that is 2.5 times slower.
void interleave_four(const float* from, std::size_t plane, float* to) {
  const FourFloats r = load_four(from), g = load_four(from + plane), b = load_four(from + 2 * plane);
  const FourFloats r0g0 = __builtin_shufflevector(r, g, 0, 4, 1, 5),
                   b0r1 = __builtin_shufflevector(b, r, 0, 0, 5, 5),
                   g1b1 = __builtin_shufflevector(g, b, 0, 4, 1, 5),
                   r2g2 = __builtin_shufflevector(r, g, 2, 6, 3, 7),
                   b2r3 = __builtin_shufflevector(b, r, 2, 2, 7, 7),
                   g3b3 = __builtin_shufflevector(g, b, 2, 6, 3, 7);
  store_four(__builtin_shufflevector(r0g0, b0r1, 0, 1, 4, 6), to);
  store_four(__builtin_shufflevector(g1b1, r2g2, 2, 3, 4, 5), to + 4);
  store_four(__builtin_shufflevector(b2r3, g3b3, 0, 2, 6, 7), to + 8);
}

// Converts a row of three planes to interleaved RGB. It writes whole cache lines at a time if the alignment
// of `to` allows this.
void interleave_row(const float* from, std::size_t plane, std::size_t width, float* to) {
  const auto one = [&](std::size_t x) {
    for (std::size_t c = 0; c < 3; ++c) to[3 * x + c] = from[c * plane + x];
  };
  std::size_t x = 0;
  for (; x < width && reinterpret_cast<std::uintptr_t>(to + 3 * x) % sizeof(FourFloats) != 0; ++x) one(x);
  for (; x + 16 <= width; x += 16)
    for (std::size_t i = x; i < x + 16; i += 4) interleave_four(from + i, plane, to + 3 * i);
  for (; x < width; ++x) one(x);
}

// Returns the maximum numbers of visible splats and intersections of recent views after another view with the
// numbers `view`. `recent` is the previous result. It is reduced by 1/64 per view, which halves it after 44
// views.
ListTotals recent_maximum(const ListTotals& recent, const ListTotals& view) {
  return {std::max(view.visible, recent.visible - recent.visible / 64),
          std::max(view.intersections, recent.intersections - recent.intersections / 64)};
}

}  // namespace

std::vector<float> padded_planes(std::span<const float> planes, const ImageShape& shape) {
  std::vector<float> padded(3 * shape.plane());
  auto from = planes.begin();
  for (std::size_t c = 0; c < 3; ++c)
    for (int y = 0; y < shape.height; ++y, from += shape.width)
      std::copy_n(from, shape.width,
                  padded.begin() + static_cast<std::ptrdiff_t>(c * shape.plane()) + y * shape.pitch());
  return padded;
}

std::vector<float> cropped_planes(std::span<const float> padded, const ImageShape& shape) {
  std::vector<float> planes;
  for (std::size_t c = 0; c < 3; ++c)
    for (int y = 0; y < shape.height; ++y) {
      const auto row = padded.begin() + static_cast<std::ptrdiff_t>(c * shape.plane()) + y * shape.pitch();
      planes.insert(planes.end(), row, row + shape.width);
    }
  return planes;
}

Renderer::Renderer(Device& device, Stages& stages)
    : device_(device), stages_(stages), slots_(device, stage_sizes::slot_floats(stages.config().raster)) {}

void Renderer::set_cameras(const std::vector<Camera>& cameras) {
  std::vector<float> records;
  for (const Camera& camera : cameras) {
    if (camera.width < 1 || camera.height < 1)
      fail(ErrorKind::data,
           "the image size {}x{} of a camera is not possible: width and height must be at least 1",
           camera.width, camera.height);
    const ImageShape shape{camera.width, camera.height};
    if (std::max(shape.tiles_x(), shape.tiles_y()) > static_cast<int>(kMaxTilesAcross))
      fail(ErrorKind::usage,
           "an image of {}x{} pixels is too large: at most {} tiles per row and column are supported",
           camera.width, camera.height, kMaxTilesAcross);
    const std::vector<float> record = camera_record(camera);
    records.insert(records.end(), record.begin(), record.end());
  }
  cameras_ = cameras;
  camera_records_ = Buffer<float>(device_, "cameras", records.size());
  camera_records_.upload(records);
}

void Renderer::reserve_splats(std::size_t n, bool for_backward) {
  reserve(device_, records_, "projected splats", n * kSplatStride);
  reserve(device_, depth_keys_, "depth keys", n);
  reserve(device_, tile_rects_, "tile rects", 2 * n);
  reserve(device_, tile_counts_, "tile counts", n);
  if (stages_.config().backward) reserve(device_, slot_offsets_, "slot offsets", n);
  if (for_backward) reserve(device_, v_records_, "splat gradients", n * kGradStride);
}

void Renderer::reserve_image(bool for_backward) {
  reserve(device_, image_, "image", 3 * shape_.plane());
  reserve(device_, transmittance_, "transmittance", shape_.plane());
  reserve(device_, tile_ranges_, "tile ranges", static_cast<std::size_t>(shape_.tiles()) + 1);
  if (stages_.config().depth) reserve(device_, depth_, "depth", shape_.plane());
  if (for_backward) reserve(device_, v_image_, "image gradient", 3 * shape_.plane());
}

BufferView<float> Renderer::v_image(const ImageShape& shape) {
  reserve(device_, v_image_, "image gradient", 3 * shape.plane());
  v_image_.zero();
  return v_image_.view();
}

void Renderer::reserve_lists(const ListTotals& totals, bool for_backward) {
  if (totals.intersections > 0xffffffffu)
    fail(ErrorKind::memory,
         "{} splats have {} intersections with the {} tiles of a {}x{} image, but at most 2^32 - 1 are "
         "possible: use smaller images or splats",
         totals.visible, totals.intersections, shape_.tiles(), shape_.width, shape_.height);
  const std::size_t n = totals.intersections;
  const DeviceInfo& info = device_.info();
  const std::size_t states = divides_lists() ? stage_sizes::list_state_floats(n) * sizeof(float) : 0;
  const unsigned floats = stage_sizes::slot_floats(stages_.config().raster);
  const std::size_t listed = std::max(n * sizeof(std::uint32_t), states), each = floats * sizeof(float);
  if (listed > info.max_allocation_bytes)
    fail(ErrorKind::memory,
         "{} intersections of splats and tiles ({}x{} image) need a buffer of {} MiB, but {} allocates at "
         "most {} MiB in one buffer: use smaller images or splats",
         n, shape_.width, shape_.height, listed >> 20, info.name, info.max_allocation_bytes >> 20);
  const std::uint64_t most = std::min(SlotStore::most(info, floats), info.memory_bytes / each);
  if (for_backward && n > most)
    fail(ErrorKind::memory,
         "{} intersections of splats and tiles ({}x{} image) need {} MiB of gradient slots, but {} can hold "
         "at most {} MiB of them: use smaller images or splats",
         n, shape_.width, shape_.height, n * each >> 20, info.name, most * each >> 20);
  reserve(device_, sorted_ids_, "sorted splats", n);
  if (stages_.config().backward) {
    reserve(device_, sorted_slots_, "sorted slots", n);
    reserve(device_, masks_, "block masks", n);
  }
  if (stages_.config().raster == RasterKind::gpu) reserve(device_, long_lists_, "long lists", 1);
  if (divides_lists())
    reserve(device_, list_states_, "list states", stage_sizes::list_state_floats(sorted_ids_.size()));
  if (for_backward) slots_.reserve(n);
}

ListTotals Renderer::forward(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                             bool for_backward) {
  const RenderGroup group{&stages_, splats};
  return forward(std::span(&group, 1), camera, settings, for_backward);
}

// The rows of a group follow those of the previous group. They overwrite the unused lanes after the last
// splat of the previous group.
void Renderer::project(bool for_backward) {
  std::size_t rows = 0;
  count_ = 0;
  for (const RenderGroup& group : groups_) {
    rows = std::max(rows, static_cast<std::size_t>(count_) + group.splats.stride);
    count_ += group.splats.count;
  }
  reserve_splats(rows, for_backward);
  std::uint32_t first = 0;
  for (const RenderGroup& group : groups_) {
    group.stages->project_forward({.splats = group.splats,
                                   .cameras = camera_records_.view(),
                                   .camera = camera_,
                                   .shape = shape_,
                                   .settings = settings_.projection,
                                   .first_record = first,
                                   .records = records_.view(),
                                   .depth_keys = depth_keys_.view(),
                                   .tile_rects = tile_rects_.view(),
                                   .tile_counts = tile_counts_.view()});
    first += group.splats.count;
  }
}

void Renderer::choose(std::span<const RenderGroup> groups, std::uint32_t camera,
                      const RenderSettings& settings, bool for_backward) {
  if (camera >= cameras_.size())
    fail(ErrorKind::internal, "view {} does not exist: there are {} cameras", camera, cameras_.size());
  for (const RenderGroup& group : groups)
    if (for_backward && !group.stages->config().backward)
      fail(ErrorKind::internal, "the gradient of a view requires stages with a backward pass");
  shape_ = {cameras_[camera].width, cameras_[camera].height};
  groups_.assign(groups.begin(), groups.end());
  camera_ = camera;
  settings_ = settings;
  for_backward_ = for_backward;
  if (settings_.sky && settings_.sky != uploaded_sky_) set_sky(*settings_.sky);
}

void Renderer::set_sky(const std::array<float, kSkyNumbers>& sky, std::span<const float> state) {
  uploaded_sky_ = sky;
  reserve(device_, sky_, "sky", kSkyState);
  if (state.empty()) {
    sky_.zero();
    state = sky;
  }
  sky_.upload(state);
}

void Renderer::sky_gradient(BufferView<float> gradient, std::uint32_t offset) {
  stages_.sky_gradient({.shape = shape_,
                        .cameras = camera_records_.view(),
                        .camera = camera_,
                        .transmittance = transmittance_.view(),
                        .v_image = v_image_.view(),
                        .gradient = gradient,
                        .gradient_offset = offset});
}

void Renderer::begin(std::span<const RenderGroup> groups, std::uint32_t camera,
                     const RenderSettings& settings, bool for_backward) {
  choose(groups, camera, settings, for_backward);
  reserve_image(for_backward);
  project(for_backward);
}

void Renderer::list_and_draw(const ListTotals& totals, bool bounded) {
  stages_.build_lists({.count = count_,
                       .totals = totals,
                       .shape = shape_,
                       .depth_keys = depth_keys_.view(),
                       .tile_rects = tile_rects_.view(),
                       .slot_offsets = slot_offsets_.view(),
                       .sorted_ids = sorted_ids_.view(),
                       .sorted_slots = last_lists().sorted_slots,
                       .tile_ranges = tile_ranges_.view(),
                       .bounded = bounded,
                       .long_lists = long_lists_.view()});
  stages_.raster_forward(last_lists());
  if (settings_.sky)
    stages_.draw_sky({.shape = shape_,
                      .cameras = camera_records_.view(),
                      .camera = camera_,
                      .sky = sky_.view(),
                      .transmittance = transmittance_.view(),
                      .image = image_.view()});
}

ListTotals Renderer::forward(std::span<const RenderGroup> groups, std::uint32_t camera,
                             const RenderSettings& settings, bool for_backward) {
  // A GPU would be idle while the host waits for the number of intersections. So the host reads this number
  // after it has enqueued all operations of the view.
  if (!for_backward && device_.info().type != DeviceType::cpu && list_room(false).intersections > 0) {
    DeferredView view = forward_deferred(groups, camera, settings, false);
    if (view.had_capacity()) return totals_ = view.totals();
  }
  return forward_counted(groups, camera, settings, for_backward);
}

ListTotals Renderer::forward_counted(std::span<const RenderGroup> groups, std::uint32_t camera,
                                     const RenderSettings& settings, bool for_backward) {
  begin(groups, camera, settings, for_backward);
  return list_counted(for_backward);
}

ListTotals Renderer::list_counted(bool for_backward) {
  totals_ = stages_.count_lists({.count = count_,
                                 .tile_counts = tile_counts_.view(),
                                 .depth_keys = depth_keys_.view(),
                                 .slot_offsets = slot_offsets_.view()});
  recent_ = recent_maximum(recent_, totals_);
  reserve_lists(totals_, for_backward);
  list_and_draw(totals_, false);
  return totals_;
}

ListTotals Renderer::list_room(bool for_backward) const {
  ListTotals room{0xffffffffu, std::min<std::uint64_t>(sorted_ids_.size(), 0xffffffffu)};
  std::uint64_t& pairs = room.intersections;
  if (recent_.visible > 0) room.visible = recent_.visible + recent_.visible / 4;
  if (recent_.intersections > 0) pairs = std::min(pairs, recent_.intersections + recent_.intersections / 4);
  if (stages_.config().backward)
    pairs = std::min<std::uint64_t>({pairs, sorted_slots_.size(), masks_.size()});
  if (for_backward) pairs = std::min(pairs, slots_.size());
  if (divides_lists() && list_states_.size() < stage_sizes::list_state_floats(pairs)) pairs = 0;
  return room;
}

DeferredView Renderer::forward_deferred(const SplatView& splats, std::uint32_t camera,
                                        const RenderSettings& settings) {
  const RenderGroup group{&stages_, splats};
  return forward_deferred(std::span(&group, 1), camera, settings, true);
}

DeferredView Renderer::forward_deferred(std::span<const RenderGroup> groups, std::uint32_t camera,
                                        const RenderSettings& settings, bool for_backward) {
  ListTotals room = list_room(for_backward);
  if (room.intersections == 0) return DeferredView(forward_counted(groups, camera, settings, for_backward));
  begin(groups, camera, settings, for_backward);
  room.visible = std::min<std::uint64_t>(room.visible, count_);
  reserve(device_, list_totals_, "list totals", 2);
  const ListTotals bounds = stages_.count_lists({.count = count_,
                                                 .tile_counts = tile_counts_.view(),
                                                 .depth_keys = depth_keys_.view(),
                                                 .slot_offsets = slot_offsets_.view(),
                                                 .totals = list_totals_.view(),
                                                 .room = room});
  auto read = device_.read_later(*list_totals_.view().memory, 0, 2 * sizeof(std::uint64_t));
  list_and_draw(bounds, true);
  return {room, std::move(read), recent_};
}

const ListTotals& DeferredView::totals() {
  if (read_) {
    std::array<std::uint64_t, 2> counted{};
    std::memcpy(counted.data(), read_->wait().data(), sizeof counted);
    totals_ = {counted[0], counted[1]};
    *recent_ = recent_maximum(*recent_, totals_);
    read_.reset();
  }
  return totals_;
}

// In stages with a backward pass, GPU kernels write slots, masks and states only if their buffers are passed.
// CPU kernels always write slots and masks, so they always get the buffers.
RasterForward Renderer::last_lists() const {
  const bool keeps = for_backward_ || keeps_lists_ || !divides_lists();
  return {.shape = shape_,
          .records = records_.view(),
          .sorted_ids = sorted_ids_.view(),
          .sorted_slots = keeps ? sorted_slots_.view() : BufferView<std::uint32_t>{},
          .tile_ranges = tile_ranges_.view(),
          .background = settings_.sky ? std::array<float, 3>{} : settings_.background,
          .image = image_.view(),
          .transmittance = transmittance_.view(),
          .depth = depth_.view(),
          .masks = keeps ? masks_.view() : BufferView<std::uint16_t>{},
          .states = keeps ? list_states_.view() : BufferView<float>{},
          .long_lists = long_lists_.view()};
}

void Renderer::backward(BufferView<float> v_params, bool accumulate) {
  backward(std::span(&v_params, 1), accumulate);
}

void Renderer::backward(std::span<const BufferView<float>> v_params, bool accumulate) {
  backward_to_records();
  backward_from_records(v_params, accumulate);
}

void Renderer::backward_from_records(std::span<const BufferView<float>> v_params, bool accumulate) {
  if (v_params.size() != groups_.size())
    fail(ErrorKind::internal, "the gradients have {} groups, but the view has {}", v_params.size(),
         groups_.size());
  std::uint32_t first = 0;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    groups_[g].stages->project_backward(projection_of(groups_[g], first, v_params[g], accumulate));
    first += groups_[g].splats.count;
  }
}

CameraGradient Renderer::camera_gradient() {
  if (settings_.sky &&
      std::any_of(settings_.sky->begin() + 3, settings_.sky->end(), [](float v) { return v != 0; }))
    fail(ErrorKind::usage,
         "the camera gradient is not available with a sky as background: render with one background colour "
         "(background = R,G,B)");
  std::array<double, kCameraGrads> sums{};
  std::uint32_t first = 0;
  for (const RenderGroup& group : groups_) {
    const std::uint32_t lanes = std::min(group.splats.stride, kCameraLanes);
    const std::size_t size = static_cast<std::size_t>(kCameraGrads) * lanes;
    if (group.splats.count == 0) continue;
    reserve(device_, v_camera_, "camera gradient", size);
    group.stages->camera_backward({projection_of(group, first, {}, false), v_camera_.view(), lanes});
    std::vector<float> values(size);
    v_camera_.download(std::span<float>(values));
    for (std::size_t i = 0; i < size; ++i) sums[i / lanes] += static_cast<double>(values[i]);
    first += group.splats.count;
  }
  CameraGradient out;
  std::copy_n(sums.begin() + kCameraGradTurn, 3, out.turn.begin());
  std::copy_n(sums.begin() + kCameraGradShift, 3, out.shift.begin());
  out.fx = sums[kCameraGradFocal], out.fy = sums[kCameraGradFocal + 1];
  out.cx = sums[kCameraGradPrincipal], out.cy = sums[kCameraGradPrincipal + 1];
  out.time = sums[kCameraGradQuery];
  std::copy_n(sums.begin() + kCameraGradQuery + 1, 4, out.extra.begin());
  return out;
}

void Renderer::learn(bool accumulate, const Regularise& penalty, const AdamStep& step) {
  if (groups_.size() != 1)
    fail(ErrorKind::internal, "an optimisation step supports one group, not {}", groups_.size());
  groups_[0].stages->learn({projection_of(groups_[0], 0, step.v_params, accumulate), penalty, step});
}

ProjectBackward Renderer::projection_of(const RenderGroup& group, std::uint32_t first,
                                        BufferView<float> v_params, bool accumulate) const {
  return {.splats = group.splats,
          .cameras = camera_records_.view(),
          .camera = camera_,
          .shape = shape_,
          .settings = settings_.projection,
          .first_record = first,
          .v_records = v_records_.view(),
          .v_params = v_params,
          .accumulate = accumulate};
}

void Renderer::backward_to_records(const MoreChannels& more) {
  if (!for_backward_)
    fail(ErrorKind::internal, "a gradient is only available for views that are rendered with for_backward");
  stages_.raster_backward({.shape = shape_,
                           .records = records_.view(),
                           .sorted_ids = sorted_ids_.view(),
                           .sorted_slots = sorted_slots_.view(),
                           .tile_ranges = tile_ranges_.view(),
                           .image = image_.view(),
                           .masks = masks_.view(),
                           .states = list_states_.view(),
                           .v_image = v_image_.view(),
                           .slots = slots_.view(),
                           .more_colours = more.colours,
                           .v_more = more.v,
                           .more_channels = more.count});
  stages_.sum_slots({.count = count_,
                     .tile_counts = tile_counts_.view(),
                     .slot_offsets = slot_offsets_.view(),
                     .slots = slots_.view(),
                     .masks = masks_.view(),
                     .records = records_.view(),
                     .v_records = v_records_.view()});
}

RenderedView Renderer::download() const {
  RenderedView out{shape_.width, shape_.height, {}, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.rgb.resize(3 * pixels);
  out.alpha.resize(pixels);
  if (stages_.config().depth) out.depth.resize(pixels);
  std::vector<std::byte> staging;
  download({out.rgb, out.alpha, out.depth}, staging);
  return out;
}

void Renderer::download(const ImageDestination& to, std::vector<std::byte>& staging) const {
  const std::size_t width = static_cast<std::size_t>(shape_.width),
                    height = static_cast<std::size_t>(shape_.height);
  const std::size_t pitch = static_cast<std::size_t>(shape_.pitch()), plane = shape_.plane();
  if (!to.rgb.empty())
    image_.show(3 * plane, staging, [&](const float* from) {
      for (std::size_t y = 0; y < height; ++y)
        interleave_row(from + y * pitch, plane, width, to.rgb.data() + 3 * y * width);
#ifdef __SSE2__
      _mm_sfence();  // makes the stores visible before other threads are notified
#endif
    });
  const auto crop = [&](const Buffer<float>& buffer, std::span<float> out, const auto& value) {
    buffer.show(plane, staging, [&](const float* from) {
      for (std::size_t y = 0; y < height; ++y)
        std::transform(from + y * pitch, from + y * pitch + width, &out[y * width], value);
    });
  };
  if (!to.alpha.empty()) crop(transmittance_, to.alpha, [](float left) { return 1.0f - left; });
  if (!to.depth.empty()) crop(depth_, to.depth, [](float depth) { return depth; });
}

}  // namespace ubs
