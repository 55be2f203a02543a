// SPDX-License-Identifier: Apache-2.0
// Renderer renders views of a splat model on a device and computes their gradients. It runs the operations of
// a view in order, forward and backward, and owns the buffers that pass data from one operation to the next.
// It uses the device only through the interfaces Stages and Device. Its buffers grow to the size that the
// views need and are reused.
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
  // Coefficients of the sky, which replaces `background` if it is present: the colour, followed by the
  // coefficients of the spherical harmonics, as in the struct Background.
  std::optional<std::array<float, kSkyNumbers>> sky = {};
};

// RenderGroup refers to splats of one dimension and variant, and to stages that are compiled for them. The
// renderer uses these stages only for the projection. For tile lists and images it uses its own stages.
struct RenderGroup {
  Stages* stages = nullptr;
  SplatView splats;
};

// These functions convert planes (3, height, width) into the layout of the buffers, (3, rows, pitch) with
// zeros beyond the image, and back.
std::vector<float> padded_planes(std::span<const float> planes, const ImageShape& shape);
std::vector<float> cropped_planes(std::span<const float> padded, const ImageShape& shape);

// ImageDestination is the destination of a downloaded view. Its members have the layout of the members of
// RenderedView. A member is not downloaded if its span is empty.
struct ImageDestination {
  std::span<float> rgb, alpha, depth;
};

// VisibleSplats holds the visible splats of a view in a process that projects its splats for this view, while
// another process renders the view. See PickDrawn in stages.hpp.
struct VisibleSplats {
  Buffer<std::uint32_t> places;
  Buffer<float> rows;  // one row per visible splat: first its record, later the gradient of the record
};

// DeferredView is a view whose rendering was started before the host knew the length of its tile lists.
class DeferredView {
 public:
  // Creates a view whose intersections were counted before it was rendered.
  explicit DeferredView(const ListTotals& known) : totals_(known) {}
  // `room` contains the maximum numbers of visible splats and intersections that the view may have. `recent`
  // contains the maxima of recent views. totals() updates `recent`, so that variable must outlive the view.
  DeferredView(const ListTotals& room, std::unique_ptr<PendingRead> read, ListTotals& recent)
      : room_(room), read_(std::move(read)), recent_(&recent) {}

  // Waits until the intersections are counted, but not until the view is rendered.
  const ListTotals& totals();
  // Returns whether the view had at most the maximum numbers of visible splats and intersections. If not, it
  // was rendered as if it had no splats, and its image and gradient must not be used.
  bool had_capacity() {
    return totals().visible <= room_.visible && totals().intersections <= room_.intersections;
  }

 private:
  ListTotals totals_;
  ListTotals room_{~std::uint64_t{0}, ~std::uint64_t{0}};
  std::unique_ptr<PendingRead> read_;  // null after the wait
  ListTotals* recent_ = nullptr;
};

// MoreChannels holds the members of RasterBackward for further channels.
struct MoreChannels {
  BufferView<float> colours, v;
  int count = 0;
};

class Renderer {
 public:
  // The splats of a SplatView that is passed to a method must have the N and the variant of `stages`. A
  // RenderGroup brings its own stages for the projection.
  Renderer(Device& device, Stages& stages);

  // Uploads the cameras that forward() and backward() refer to by index.
  void set_cameras(const std::vector<Camera>& cameras);

  // Renders one view into image(). With for_backward it keeps the data that backward() needs. Waits until the
  // intersections are counted. Without for_backward, all operations of the view are enqueued on a GPU before
  // this wait, if earlier views have allocated the lists. If the capacity of these lists turns out to be too
  // small, the view is rendered a second time.
  ListTotals forward(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     bool for_backward);
  // This overload renders several groups. Splats are numbered consecutively in the order of the groups.
  // Splats with equal depths are blended in the order of these numbers.
  ListTotals forward(std::span<const RenderGroup> groups, std::uint32_t camera,
                     const RenderSettings& settings, bool for_backward);
  // Renders one view for a later call of backward(), without waiting for the size of its lists. The view can
  // have up to 1.25 times as many visible splats and intersections as the maxima of recent views, if the
  // existing buffers are large enough. If there are no buffers yet, the call waits like forward(). Image and
  // gradient must not be used before DeferredView::had_capacity() has returned true. If had_capacity()
  // returns false, the caller must render the view again with forward(), which enlarges the buffers.
  DeferredView forward_deferred(const SplatView& splats, std::uint32_t camera,
                                const RenderSettings& settings);
  // Computes the gradient of the parameters for the last rendered view from v_image(), the gradient of its
  // image. The result is stored in v_params, which has one buffer per group with the layout of the
  // parameters. With `accumulate`, it is added to the previous contents of v_params.
  void backward(BufferView<float> v_params, bool accumulate);
  void backward(std::span<const BufferView<float>> v_params, bool accumulate);
  // These are the two halves of backward(). backward_to_records() computes the gradient of the projected
  // splats, v_records(). backward_from_records() computes the gradient of the parameters from v_records().
  // `more` are the channels in addition to red, green and blue, which RasterBackward describes.
  void backward_to_records(const MoreChannels& more = {});
  void backward_from_records(std::span<const BufferView<float>> v_params, bool accumulate);
  // The next five functions are for views whose splats are projected by one process and whose image is
  // rendered by another process (shared_renderer.hpp). In the process that projects, project_only() computes
  // the records of the visible splats, waits, and returns their number. Later, when the same rows contain the
  // gradients of the records, take_gradient() copies them to v_records(). Then the caller must call
  // backward_from_records() or learn().
  std::uint32_t project_only(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                             VisibleSplats& drawn);
  void take_gradient(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     const VisibleSplats& drawn);
  // In the process that renders, the caller stores `drawn` records in drawn_records(), calls
  // forward_projected(), and then calls backward_to_records(). take_v_records() swaps `rows` with the buffer
  // of v_records().
  Buffer<float>& drawn_records(std::uint32_t drawn, bool for_backward);
  ListTotals forward_projected(std::uint32_t drawn, std::uint32_t camera, const RenderSettings& settings,
                               bool for_backward);
  void take_v_records(Buffer<float>& rows) { std::swap(rows, v_records_); }
  // Waits for the device and returns the gradient with respect to the camera. Must be called after
  // backward_to_records(). The stages must not have frozen parameters. Throws Error(usage) if the background
  // is a sky whose colour depends on the direction, because that part of the gradient is not implemented.
  CameraGradient camera_gradient();
  // Runs backward_from_records() together with the optimiser step that uses the gradient (Stages::learn).
  // There must be exactly one group. With `accumulate`, the v_params of `step` already contain the gradient
  // of the earlier views of this optimiser step, and the gradient of the last view is added.
  void learn(bool accumulate, const Regularise& penalty, const AdamStep& step);

  ImageShape shape() const { return shape_; }
  BufferView<float> image() const { return image_.view(); }                  // (3, rows, pitch)
  BufferView<float> transmittance() const { return transmittance_.view(); }  // (rows, pitch)
  BufferView<float> depth() const { return depth_.view(); }  // empty unless KernelConfig::depth
  // Returns the gradient of the image, which the caller fills between forward and backward.
  BufferView<float> v_image() const { return v_image_.view(); }
  // Returns the state of the sky that the last view was rendered with. Training may change this state on the
  // device. It is kept until a view is rendered with settings that contain a different sky. The returned view
  // is empty if no sky was used yet.
  BufferView<float> sky() const { return sky_.view(); }  // (kSkyState)
  // Uploads the state of the sky that is used with settings that contain `sky`. If `state` is empty, the
  // state at the start of training is used: the coefficients of `sky`, and zeros for the optimiser.
  void set_sky(const std::array<float, kSkyNumbers>& sky, std::span<const float> state = {});
  // Computes the gradient of the sky's coefficients for the last rendered view from v_image(). Writes it to
  // `gradient`, starting at index `offset`.
  void sky_gradient(BufferView<float> gradient, std::uint32_t offset);
  // Returns v_image() for a view of this size, filled with zeros. It can be called before forward(), which
  // does not change v_image().
  BufferView<float> v_image(const ImageShape& shape);
  // Returns the projected splats of the last view (splats of all groups, kSplatStride).
  BufferView<float> records() const {
    return {records_.view().memory, static_cast<std::size_t>(count_) * kSplatStride};
  }
  // Returns the gradient of the projected splats (splats of all groups, kGradStride). It is valid after
  // backward_to_records().
  BufferView<float> v_records() const {
    return {v_records_.view().memory, static_cast<std::size_t>(count_) * kGradStride};
  }
  // Returns the inputs and outputs of the rasteriser for the last rendered view. They are valid until the
  // next view.
  RasterForward last_lists() const;
  // A GPU writes the sorted slots, masks and states of last_lists() only for views that are rendered with
  // for_backward. After keep_lists(), it writes them for every view. Call keep_lists() before the view is
  // rendered if Stages::measure_weights() will read them.
  void keep_lists() { keeps_lists_ = true; }
  // Rasterises the same lists again with the current contents of the records, on a black background.
  void draw_again() {
    RasterForward again = last_lists();
    again.background = {0, 0, 0};
    stages_.raster_forward(again);
  }
  // These functions return, for each splat of the last view, the number of its tiles and its first slot.
  BufferView<std::uint32_t> tile_counts() const { return tile_counts_.view(); }
  BufferView<std::uint32_t> slot_offsets() const { return slot_offsets_.view(); }
  // Waits for the device and returns the last rendered view.
  RenderedView download() const;
  // Downloads the last rendered view into existing memory. `staging` is temporary memory; pass the same
  // vector for every image to reuse it.
  void download(const ImageDestination& to, std::vector<std::byte>& staging) const;
  // Returns the capacity of the lists in (tile, splat) pairs. It is at least the maximum number of pairs of
  // all views so far.
  std::uint64_t intersection_capacity() const { return sorted_ids_.size(); }
  // Returns the number of (tile, splat) pairs of the last forward().
  std::uint64_t intersections() const { return totals_.intersections; }
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
  // Returns the maximum numbers of visible splats and intersections that a view may have if it is rendered
  // before they are counted. They are at most 1.25 times the maxima of recent views, because CUDA also sorts
  // the unused entries. All existing buffers are large enough for the number of intersections. If this number
  // is 0, the view cannot be rendered without waiting. The number of visible splats may exceed the number of
  // all splats.
  ListTotals list_room(bool for_backward) const;
  ListTotals forward_counted(std::span<const RenderGroup> groups, std::uint32_t camera,
                             const RenderSettings& settings, bool for_backward);
  DeferredView forward_deferred(std::span<const RenderGroup> groups, std::uint32_t camera,
                                const RenderSettings& settings, bool for_backward);

  Device& device_;
  Stages& stages_;
  std::vector<Camera> cameras_;
  Buffer<float> camera_records_;

  Buffer<float> records_, v_records_;
  Buffer<std::uint32_t> depth_keys_, tile_rects_, tile_counts_, slot_offsets_;
  Buffer<std::uint64_t> list_totals_;  // (2): the numbers that DeferredView::totals() reads
  ListTotals recent_;                  // results of recent_maximum() in renderer.cpp
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
