// SPDX-License-Identifier: Apache-2.0
// The order of the stages for one view, forward and backward, and the buffers between them.
// Knows only the stage interface; buffers grow to what the views need and stay.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "host/device/stages.hpp"
#include "host/pipeline/camera_gradient.hpp"
#include "host/pipeline/slot_store.hpp"
#include "host/scene/camera.hpp"
#include "kernels/layout.h"

namespace ubs {

struct RenderSettings {
  ProjectionSettings projection;
  std::array<float, 3> background{0, 0, 0};
  std::optional<std::array<float, kSkyNumbers>> sky =
      {};  // in its place, as in Background: colour, harmonics
};

// Splats of one dimension and form, with stages that are specialised for them. Of those the projection is
// used alone; lists and images are the renderer's.
struct RenderGroup {
  Stages* stages = nullptr;
  SplatView splats;
};

// Host copy of a rendered view, unpadded and interleaved.
struct RenderedView {
  int width = 0, height = 0;
  std::vector<float> rgb;    // (height, width, 3), not clamped
  std::vector<float> alpha;  // (height, width)
  std::vector<float> depth;  // (height, width), empty unless KernelConfig::depth
};

// Planes (3, height, width) as buffers have them, (3, rows, pitch) with zeros beyond the image; and back.
std::vector<float> padded_planes(std::span<const float> planes, const ImageShape& shape);
std::vector<float> cropped_planes(std::span<const float> padded, const ImageShape& shape);

// Where to put one: as in RenderedView; what is empty is not wanted.
struct PictureRoom {
  std::span<float> rgb, alpha, depth;
};

// Splats of a view that are drawn, for a process that draws what others project (stages.hpp, PickDrawn).
struct DrawnSplats {
  Buffer<std::uint32_t> places;
  Buffer<float> rows;  // records of those drawn, one behind the other; later their gradients
};

// A view that was drawn for backward before the host knew how long its lists are.
class UncountedView {
 public:
  explicit UncountedView(const ListTotals& known) : totals_(known) {}
  UncountedView(std::uint64_t room, std::unique_ptr<PendingRead> read)
      : room_(room), read_(std::move(read)) {}

  // Waits until the view is counted, not until it is drawn.
  const ListTotals& totals();
  // Where its lists had no room it was drawn as one without splats: image and gradient are not those of the
  // view.
  bool had_room() { return totals().intersections <= room_; }

 private:
  ListTotals totals_;
  std::uint64_t room_ = ~std::uint64_t{0};
  std::unique_ptr<PendingRead> read_;  // until it has been waited for
};

class Renderer {
 public:
  // A SplatView given later must have the N of the stages; groups have their own.
  Renderer(Device& device, Stages& stages);

  // Uploads the cameras that forward() and backward() refer to by index.
  void set_cameras(const std::vector<Camera>& cameras);

  // Renders one view into image(). for_backward keeps what backward() needs. Waits until the view is counted;
  // for drawing alone GPUs are given all of the view before (twice, where its lists had no room).
  ListTotals forward(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     bool for_backward);
  // The same with several groups: splats are numbered through in their order, which also decides between
  // equal depths.
  ListTotals forward(std::span<const RenderGroup> groups, std::uint32_t camera,
                     const RenderSettings& settings, bool for_backward);
  // For backward, without waiting for the size of the lists: they get the room that buffers have. Only where
  // there is none yet it waits after all. Nothing may be made of image and gradient before
  // UncountedView::had_room() has been asked; forward() makes room.
  UncountedView forward_uncounted(const SplatView& splats, std::uint32_t camera,
                                  const RenderSettings& settings);
  // Gradient of the view rendered last, from v_image() into v_params (layout of the parameters), one a group.
  void backward(BufferView<float> v_params, bool accumulate);
  void backward(std::span<const BufferView<float>> v_params, bool accumulate);
  // The same in two halves, before and after the gradient of the projected splats.
  void backward_to_records();
  void backward_from_records(std::span<const BufferView<float>> v_params, bool accumulate);
  // Parts of a view of which one process projects splats and another one draws them (shared_renderer.hpp).
  // For the one that projects: forward as far as the records of those drawn, whose number it returns (waits),
  // and from their gradient in the same rows on, before the second half of backward() or learn().
  std::uint32_t project_only(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                             DrawnSplats& drawn);
  void take_gradient(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     const DrawnSplats& drawn);
  // For the one that draws: from `drawn` records on that have been put into drawn_records(), to be followed
  // by the first half of backward(). `rows` then changes places with v_records().
  Buffer<float>& drawn_records(std::uint32_t drawn, bool for_backward);
  ListTotals forward_projected(std::uint32_t drawn, std::uint32_t camera, const RenderSettings& settings,
                               bool for_backward);
  void take_v_records(Buffer<float>& rows) { std::swap(rows, v_records_); }
  // With respect to the camera, after the first half. Waits. The stages must not have anything frozen. Throws
  // Error(usage) before a sky whose colour depends on the direction: that part is missing.
  CameraGradient camera_gradient();
  // For splats of one group the second half with the step that uses the gradient (Stages::learn). With
  // `accumulate` the step's v_params hold the gradient of its earlier views.
  void learn(bool accumulate, const Regularise& penalty, const AdamStep& step);

  ImageShape shape() const { return shape_; }
  BufferView<float> image() const { return image_.view(); }                  // (3, rows, pitch)
  BufferView<float> transmittance() const { return transmittance_.view(); }  // (rows, pitch)
  BufferView<float> depth() const { return depth_.view(); }      // empty unless KernelConfig::depth
  BufferView<float> v_image() const { return v_image_.view(); }  // to be filled between forward and backward
  // Of the sky that the settings of the last view had, where it may be learnt on: it stays until settings
  // have another one. Empty without a sky.
  BufferView<float> sky() const { return sky_.view(); }  // (kSkyState)
  // The same for settings that have `sky`: its state, or none, where learning begins.
  void set_sky(const std::array<float, kSkyNumbers>& sky, std::span<const float> state = {});
  void sky_gradient(BufferView<float> gradient,
                    std::uint32_t offset);  // of the view rendered last, from v_image()
  // The same before forward(), for a view of this size: zeros, which forward() leaves alone.
  BufferView<float> v_image(const ImageShape& shape);
  // Gradient of the projected splats (splats of all groups, kGradStride), after the first half of
  // backward.
  BufferView<float> v_records() const {
    return {v_records_.view().memory, static_cast<std::size_t>(count_) * kGradStride};
  }
  // What the view rendered last was made of, until the next one.
  RasterForward last_lists() const;
  // Draws them once more, with what has been written into the records, in front of black.
  void draw_again() {
    RasterForward again = last_lists();
    again.background = {0, 0, 0};
    stages_.raster_forward(again);
  }
  BufferView<std::uint32_t> tile_counts() const { return tile_counts_.view(); }
  BufferView<std::uint32_t> slot_offsets() const { return slot_offsets_.view(); }
  RenderedView download() const;
  // `staging`: memory that is kept between pictures.
  void download(const PictureRoom& to, std::vector<std::byte>& staging) const;
  // (tile, splat) pairs that there is room for: the most of any view so far, with the buffers' headroom.
  std::uint64_t intersection_capacity() const { return sorted_ids_.size(); }
  std::uint64_t intersections() const { return totals_.intersections; }  // of the last forward()
  std::uint32_t camera_count() const { return static_cast<std::uint32_t>(cameras_.size()); }

 private:
  void choose(std::span<const RenderGroup> groups, std::uint32_t camera, const RenderSettings& settings,
              bool for_backward);
  ListTotals list_counted(bool for_backward);
  void begin(std::span<const RenderGroup> groups, std::uint32_t camera, const RenderSettings& settings,
             bool for_backward);
  void list_and_draw(const ListTotals& totals, bool bounded);
  void reserve_splats(std::size_t rows, bool for_backward);
  void project(bool for_backward);
  ProjectBackward projection_of(const RenderGroup& group, std::uint32_t first, BufferView<float> v_params,
                                bool accumulate) const;
  void reserve_image(bool for_backward);
  void reserve_lists(const ListTotals& totals, bool for_backward);
  bool divides_lists() const {
    return stages_.config().backward && stages_.config().raster == RasterKind::gpu;
  }
  std::uint64_t list_room(bool for_backward) const;  // intersections that all buffers have room for
  ListTotals forward_counted(std::span<const RenderGroup> groups, std::uint32_t camera,
                             const RenderSettings& settings, bool for_backward);
  UncountedView forward_uncounted(std::span<const RenderGroup> groups, std::uint32_t camera,
                                  const RenderSettings& settings, bool for_backward);

  Device& device_;
  Stages& stages_;
  std::vector<Camera> cameras_;
  Buffer<float> camera_records_;

  Buffer<float> records_, v_records_;
  Buffer<std::uint32_t> depth_keys_, tile_rects_, tile_counts_, slot_offsets_;
  Buffer<std::uint64_t> list_totals_;  // (2), of forward_uncounted()
  Buffer<std::uint32_t> sorted_ids_, sorted_slots_, tile_ranges_, long_lists_;
  Buffer<std::uint16_t> masks_;
  Buffer<float> list_states_;
  SlotStore slots_;
  Buffer<float> image_, v_image_, transmittance_, depth_;
  Buffer<float> v_camera_;  // with the first camera_gradient()
  Buffer<float> sky_;       // with the first sky
  std::optional<std::array<float, kSkyNumbers>> uploaded_sky_;

  // Of the view rendered last.
  ImageShape shape_;
  std::vector<RenderGroup> groups_;
  std::uint32_t count_ = 0;  // splats of all groups
  std::uint32_t camera_ = 0;
  RenderSettings settings_;
  ListTotals totals_;  // of the last forward()
};

}  // namespace ubs
