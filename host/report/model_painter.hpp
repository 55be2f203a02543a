// SPDX-License-Identifier: Apache-2.0
// Draws a model, and parts of it, from a set of cameras with colour, alpha and depth. Parts are drawn by the
// stages of the whole: no kernel is built twice.
#pragma once

#include <cstddef>
#include <vector>

#include "host/pipeline/device_groups.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs {

class ModelPainter {
 public:
  ModelPainter(Device& device, const MixedModel& model, const TrainSettings& settings);

  void set_cameras(const std::vector<Camera>& cameras) { renderer_.set_cameras(cameras); }
  RenderedView draw(std::size_t camera);
  // The groups of `part` must be of dimensions that the model has. May be empty.
  RenderedView draw(std::size_t camera, const MixedModel& part);

 private:
  RenderedView draw(std::size_t camera, std::span<const RenderGroup> groups);

  Device& device_;
  DeviceGroups model_;
  Renderer renderer_;
  RenderSettings settings_;
};

// A camera of width x height pixels, 45 degrees along the shorter side, on the orbit that shows the bulk of
// the model (host/view/scene_frame.hpp) from 25 degrees above, at `azimuth` [rad]. For models without any
// camera.
Camera circling_camera(const MixedModel& model, double azimuth, int width, int height);

}  // namespace ubs
