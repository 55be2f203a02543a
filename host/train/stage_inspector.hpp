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
  std::int64_t splat = -1;  // -1: none in particular
};

class StageInspector final : public Stages {
 public:
  StageInspector(Device& device, Stages& stages) : device_(device), stages_(stages) {}

  const std::optional<StageFinding>& finding() const { return finding_; }

  const KernelConfig& config() const override { return stages_.config(); }
  void project_forward(const ProjectForward& a) override;
  ListTotals count_lists(const CountLists& a) override { return stages_.count_lists(a); }
  void build_lists(const BuildLists& a) override { stages_.build_lists(a); }
  void raster_forward(const RasterForward& a) override;
  void image_loss(const ImageLoss& a) override;
  void raster_backward(const RasterBackward& a) override;
  void sum_slots(const SumSlots& a) override;
  void project_backward(const ProjectBackward& a) override;
  void regularise(const Regularise& a) override;
  void adam(const AdamStep& a) override { stages_.adam(a); }
  std::uint32_t relocate(const Relocate& a) override { return stages_.relocate(a); }
  void grow(const Grow& a) override { stages_.grow(a); }
  void add_noise(const AddNoise& a) override { stages_.add_noise(a); }

 private:
  void look_at_image(const char* stage, const char* what, const View1<float>& planes,
                     const ImageShape& shape);
  void look_at_gradient(const char* stage, const View1<float>& v_params, const SplatView& splats);

  Device& device_;
  Stages& stages_;
  std::optional<StageFinding> finding_;
};

}  // namespace ubs
