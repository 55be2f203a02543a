// SPDX-License-Identifier: Apache-2.0
// Painter renders images for the clients of the server. It has buffers of its own, so that it does not change
// the state of a training run. Clients may send any camera, so Painter refuses views that would need too much
// memory.
#pragma once

#include <span>
#include <string>

#include "host/dataset/image.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs::serve {

class Painter {
 public:
  Painter(Device& device, Stages& stages, const RenderSettings& settings);

  // Renders an image. Throws Error(memory) for a view with more than `most` intersections of splats and
  // tiles.
  Image8 image(std::span<const RenderGroup> groups, const Camera& camera, std::uint64_t most);
  // Renders an image like image(), and returns it as a JPEG file or, with `exact`, as a PNG file.
  std::string draw(std::span<const RenderGroup> groups, const Camera& camera, bool exact, std::uint64_t most);

  void use(const RenderSettings& settings) { settings_ = settings; }

 private:
  // Bounded runs operations with the given stages, but refuses views with more than `most` intersections.
  class Bounded final : public Stages {
   public:
    explicit Bounded(Stages& stages) : stages_(stages) {}
    const KernelConfig& config() const override { return stages_.config(); }
    Outcome run(const Operation& operation) override;
    std::uint64_t most = 0;

   private:
    Stages& stages_;
  };

  Bounded stages_;
  Renderer renderer_;
  RenderSettings settings_;
};

}  // namespace ubs::serve
