// SPDX-License-Identifier: Apache-2.0
// Stages that look at what each operation of a view's forward and backward pass wrote and remember the first
// value that is not finite: which stage made it, and where. For the inquest after training met one; every
// operation waits and copies its results to the host.
#pragma once

#include <optional>
#include <string>

#include "host/device/stages.hpp"

namespace ubs {

struct StageFinding {
  std::string stage;        // as the operations of stages.hpp are called
  std::string where;        // "opacity of its record", "pixel (12, 7), channel 0"
  std::int64_t splat = -1;  // row of its record; -1: none in particular
};

class StageInspector final : public Stages {
 public:
  StageInspector(Device& device, Stages& stages) : device_(device), stages_(stages) {}

  const std::optional<StageFinding>& finding() const { return finding_; }

  const KernelConfig& config() const override { return stages_.config(); }
  Outcome run(const Operation& operation) override;

 private:
  void look_at(const ProjectForward& a);
  void look_at(const RasterForward& a);
  void look_at(const ImageLoss& a);
  void look_at(const SumSlots& a);
  void look_at_image(const char* stage, const char* what, const BufferView<float>& planes,
                     const ImageShape& shape);
  void look_at_gradient(const char* stage, const BufferView<float>& v_params, const SplatView& splats);

  Device& device_;
  Stages& stages_;
  std::optional<StageFinding> finding_;
};

}  // namespace ubs
