// SPDX-License-Identifier: Apache-2.0
// Painter renders images for viewers. It has stages and buffers of its own, so that it does not change the
// state of a training. Clients may send any camera, so a view that would need too much memory is refused.
#pragma once

#include <span>
#include <string>

#include "host/pipeline/renderer.hpp"

namespace ubs::serve {

class Painter {
 public:
  Painter(Device& device, Stages& stages, const RenderSettings& settings);

  // Renders a JPEG or, with `exact`, a PNG. Throws Error(memory) for a view with more than `most`
  // intersections of splats and tiles.
  std::string draw(std::span<const RenderGroup> groups, const Camera& camera, bool exact, std::uint64_t most);

  void use(const RenderSettings& settings) { settings_ = settings; }

 private:
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
