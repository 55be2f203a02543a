// SPDX-License-Identifier: Apache-2.0
// Renderer runs the stages for one view in order, forward and backward, and owns the buffers between them. It
// only uses the interface of the stages. Its buffers grow to the size that the views need and are reused.
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
#include "host/scene/rendered_view.hpp"
#include "kernels/layout.h"

namespace ubs {

struct RenderSettings {
  ProjectionSettings projection;
  std::array<float, 3> background{0, 0, 0};
  // The sky, which replaces `background`. Its numbers are those of Background: colour, harmonics.
  std::optional<std::array<float, kSkyNumbers>> sky = {};
};

// Splats of one dimension and variant, with stages that are specialised for them. Only the projection of
// these stages is used; lists and images use the stages of the renderer.
struct RenderGroup {
  Stages* stages = nullptr;
  SplatView splats;
};

// These functions convert planes (3, height, width) into the layout of the buffers, (3, rows, pitch) with
// zeros beyond the image, and back.
std::vector<float> padded_planes(std::span<const float> planes, const ImageShape& shape);
std::vector<float> cropped_planes(std::span<const float> padded, const ImageShape& shape);

// Memory for a downloaded view, with the layout of RenderedView. Empty members are not downloaded.
struct PictureRoom {
  std::span<float> rgb, alpha, depth;
};

// The visible splats of a view, in a process whose splats are projected for a view that another process
// renders (PickDrawn in stages.hpp).
struct DrawnSplats {
  Buffer<std::uint32_t> places;
  Buffer<float> rows;  // compact rows: the records of the visible splats, and later their gradients
};

// A view that was rendered before the host knew the length of its lists.
class UncountedView {
 public:
  explicit UncountedView(const ListTotals& known) : totals_(known) {}
  // recent: the longest lists of recent views, which totals() updates; it must outlive the view.
  UncountedView(std::uint64_t room, std::unique_ptr<PendingRead> read, std::uint64_t& recent)
      : room_(room), read_(std::move(read)), recent_(&recent) {}

  // Waits until the intersections are counted, but not until the view is rendered.
  const ListTotals& totals();
  // Returns whether the lists fitted. If not, the view was rendered as if it had no splats, so image and
  // gradient are not those of the view.
  bool had_room() { return totals().intersections <= room_; }

 private:
  ListTotals totals_;
  std::uint64_t room_ = ~std::uint64_t{0};
  std::unique_ptr<PendingRead> read_;  // null after the wait
  std::uint64_t* recent_ = nullptr;
};

class Renderer {
 public:
  // Each SplatView that is passed later must have the N of these stages. Groups have stages of their own.
  Renderer(Device& device, Stages& stages);

  // Uploads the cameras that forward() and backward() refer to by index.
  void set_cameras(const std::vector<Camera>& cameras);

  // Renders one view into image(). With for_backward it keeps the data that backward() needs. Waits until the
  // intersections are counted. Without for_backward, a GPU gets all operations of the view before this wait;
  // if the lists do not fit, the view is then rendered a second time.
  ListTotals forward(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     bool for_backward);
  // This overload renders several groups. Splats are numbered consecutively in the order of the groups. This
  // number also decides the order at equal depths.
  ListTotals forward(std::span<const RenderGroup> groups, std::uint32_t camera,
                     const RenderSettings& settings, bool for_backward);
  // Renders for backward without waiting for the size of the lists. The lists can be 1.25 times as long as
  // those of recent views, if the buffers are large enough; if there is no buffer yet, the call waits. Image
  // and gradient must not be used before UncountedView::had_room() has returned true. If it returns false,
  // forward() enlarges the buffers.
  UncountedView forward_uncounted(const SplatView& splats, std::uint32_t camera,
                                  const RenderSettings& settings);
  // Computes the gradient of the last rendered view, from v_image() into v_params, which has the layout of
  // the parameters and one buffer per group.
  void backward(BufferView<float> v_params, bool accumulate);
  void backward(std::span<const BufferView<float>> v_params, bool accumulate);
  // The two halves of backward(): the first one computes the gradient of the projected splats, and the second
  // one continues from there.
  void backward_to_records();
  void backward_from_records(std::span<const BufferView<float>> v_params, bool accumulate);
  // Parts of a view for which one process projects splats and another process renders them
  // (shared_renderer.hpp).
  // In the process that projects, project_only() computes the records of the visible splats, waits, and
  // returns their number. take_gradient() later reads the gradients from the same rows; the second half of
  // backward(), or learn(), must follow.
  std::uint32_t project_only(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                             DrawnSplats& drawn);
  void take_gradient(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     const DrawnSplats& drawn);
  // In the process that renders, the caller stores `drawn` records in drawn_records() and calls
  // forward_projected(), and then the first half of backward(). take_v_records() swaps `rows` with the buffer
  // of v_records().
  Buffer<float>& drawn_records(std::uint32_t drawn, bool for_backward);
  ListTotals forward_projected(std::uint32_t drawn, std::uint32_t camera, const RenderSettings& settings,
                               bool for_backward);
  void take_v_records(Buffer<float>& rows) { std::swap(rows, v_records_); }
  // Waits for the device and returns the gradient with respect to the camera. Must be called after the first
  // half of backward(). The stages must not have frozen parameters. Throws Error(usage) if the background is
  // a sky whose colour depends on the direction, because that part of the gradient is not implemented.
  CameraGradient camera_gradient();
  // Runs the second half of backward() together with the optimiser step that uses the gradient
  // (Stages::learn). There must be one group. With `accumulate`, the v_params of `step` hold the gradient of
  // the earlier views of the step.
  void learn(bool accumulate, const Regularise& penalty, const AdamStep& step);

  ImageShape shape() const { return shape_; }
  BufferView<float> image() const { return image_.view(); }                  // (3, rows, pitch)
  BufferView<float> transmittance() const { return transmittance_.view(); }  // (rows, pitch)
  BufferView<float> depth() const { return depth_.view(); }  // empty unless KernelConfig::depth
  // Returns the gradient of the image, which the caller fills between forward and backward.
  BufferView<float> v_image() const { return v_image_.view(); }
  // Returns the state of the sky that the settings of the last view had. Training may change it on the
  // device. It stays until settings with a different sky are used. The view is empty if there is no sky.
  BufferView<float> sky() const { return sky_.view(); }  // (kSkyState)
  // Uploads the state that belongs to settings with `sky`. If `state` is empty, the state is that at the
  // start of training.
  void set_sky(const std::array<float, kSkyNumbers>& sky, std::span<const float> state = {});
  // Computes the gradient of the sky for the last rendered view, from v_image().
  void sky_gradient(BufferView<float> gradient, std::uint32_t offset);
  // Returns v_image() for a view of this size before forward() is called. It is filled with zeros, and
  // forward() does not change it.
  BufferView<float> v_image(const ImageShape& shape);
  // Returns the projected splats of the last view (splats of all groups, kSplatStride).
  BufferView<float> records() const {
    return {records_.view().memory, static_cast<std::size_t>(count_) * kSplatStride};
  }
  // Returns the gradient of the projected splats (splats of all groups, kGradStride), after the first half of
  // backward().
  BufferView<float> v_records() const {
    return {v_records_.view().memory, static_cast<std::size_t>(count_) * kGradStride};
  }
  // Returns the inputs and outputs of the rasteriser for the last rendered view. They are valid until the
  // next view.
  RasterForward last_lists() const;
  // A GPU writes the sorted slots, masks and states of last_lists() only for views with for_backward. After
  // this call it writes them for every view. Call it before measure_weights(), which reads them.
  void keep_lists() { keeps_lists_ = true; }
  // Rasterises the same lists again with the current contents of the records, on a black background.
  void draw_again() {
    RasterForward again = last_lists();
    again.background = {0, 0, 0};
    stages_.raster_forward(again);
  }
  BufferView<std::uint32_t> tile_counts() const { return tile_counts_.view(); }
  BufferView<std::uint32_t> slot_offsets() const { return slot_offsets_.view(); }
  RenderedView download() const;
  // `staging` is temporary memory. Pass the same vector for every image to reuse it.
  void download(const PictureRoom& to, std::vector<std::byte>& staging) const;
  // Returns the capacity of the lists in (tile, splat) pairs: the maximum of all views so far, plus the
  // headroom of the buffers.
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
  // Returns the number of intersections for which the lists of a view have room before the intersections are
  // counted. All buffers are large enough for this number. It is at most 1.25 times the number of
  // intersections of recent views, because CUDA also sorts unused entries.
  std::uint64_t list_room(bool for_backward) const;
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
  std::uint64_t recent_ = 0;           // intersections; see recent_maximum()
  Buffer<std::uint32_t> sorted_ids_, sorted_slots_, tile_ranges_, long_lists_;
  Buffer<std::uint16_t> masks_;
  Buffer<float> list_states_;
  bool keeps_lists_ = false;
  SlotStore slots_;
  Buffer<float> image_, v_image_, transmittance_, depth_;
  Buffer<float> v_camera_;  // allocated by the first camera_gradient()
  Buffer<float> sky_;       // allocated by the first sky
  std::optional<std::array<float, kSkyNumbers>> uploaded_sky_;

  // Data of the last rendered view.
  ImageShape shape_;
  bool for_backward_ = false;
  std::vector<RenderGroup> groups_;
  std::uint32_t count_ = 0;  // splats of all groups
  std::uint32_t camera_ = 0;
  RenderSettings settings_;
  ListTotals totals_;  // of the last forward()
};

}  // namespace ubs
