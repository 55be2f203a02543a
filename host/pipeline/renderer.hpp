// SPDX-License-Identifier: Apache-2.0
// The order of the stages for one view, forward and backward, and the buffers between them.
// Knows only the stage interface; buffers grow to what the views need and stay.
#pragma once

#include <vector>

#include "host/device/stages.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

struct RenderSettings {
  ProjectionSettings projection;
  std::array<float, 3> background{0, 0, 0};
};

// Host copy of a rendered view, unpadded and interleaved.
struct RenderedView {
  int width = 0, height = 0;
  std::vector<float> rgb;    // (height, width, 3), not clamped
  std::vector<float> alpha;  // (height, width)
  std::vector<float> depth;  // (height, width), empty unless KernelConfig::depth
};

class Renderer {
 public:
  // The stages decide N; every SplatView given later must have the same N.
  Renderer(Device& device, Stages& stages);

  // Uploads the cameras that forward() and backward() refer to by index.
  void set_cameras(const std::vector<Camera>& cameras);

  // Renders one view into image(). for_backward keeps what backward() needs.
  ListTotals forward(const SplatView& splats, std::uint32_t camera, const RenderSettings& settings,
                     bool for_backward);
  // Gradient of the view rendered last, from v_image() into v_params (layout of the parameters).
  void backward(View1<float> v_params, bool accumulate);

  ImageShape shape() const { return shape_; }
  View1<float> image() const { return image_.view(); }      // (3, rows, pitch)
  View1<float> v_image() const { return v_image_.view(); }  // to be filled between forward and backward
  RenderedView download() const;
  // (tile, splat) pairs that there is room for: the most of any view so far, with the buffers' headroom.
  std::uint64_t intersection_capacity() const { return sorted_ids_.size(); }
  std::uint64_t intersections() const { return totals_.intersections; }  // of the view rendered last
  std::uint32_t camera_count() const { return static_cast<std::uint32_t>(cameras_.size()); }

 private:
  void reserve_splats(std::uint32_t stride, bool for_backward);
  void reserve_image(bool for_backward);
  void reserve_lists(const ListTotals& totals, bool for_backward);

  Device& device_;
  Stages& stages_;
  std::vector<Camera> cameras_;
  Buffer<float> camera_records_;

  Buffer<float> records_, v_records_;
  Buffer<std::uint32_t> depth_keys_, tile_rects_, tile_counts_, visible_ids_, slot_offsets_;
  Buffer<std::uint32_t> sorted_ids_, sorted_slots_, tile_ranges_;
  Buffer<std::uint16_t> masks_;
  Buffer<float> slots_;
  Buffer<float> image_, v_image_, transmittance_, depth_;

  // Of the last forward().
  ImageShape shape_;
  SplatView splats_;
  std::uint32_t camera_ = 0;
  RenderSettings settings_;
  ListTotals totals_;
};

}  // namespace ubs
