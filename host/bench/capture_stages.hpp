// SPDX-License-Identifier: Apache-2.0
// Stages that pass every call on and remember its arguments, so that one operation of a training step can be
// repeated alone, on the buffers as the step left them. The arguments refer to buffers of the renderer or
// trainer that made the call: they live as long as these, and until their buffers grow.
#pragma once

#include <memory>
#include <utility>

#include "host/device/stages.hpp"

namespace ubs::bench {

class CaptureStages final : public Stages {
 public:
  explicit CaptureStages(std::unique_ptr<Stages> stages) : stages_(std::move(stages)) {}

  const KernelConfig& config() const override { return stages_->config(); }
  void project_forward(const ProjectForward& a) override {
    stages_->project_forward(last.project_forward = a);
  }
  ListTotals count_lists(const CountLists& a) override { return stages_->count_lists(last.count_lists = a); }
  void build_lists(const BuildLists& a) override { stages_->build_lists(last.build_lists = a); }
  void raster_forward(const RasterForward& a) override { stages_->raster_forward(last.raster_forward = a); }
  void image_loss(const ImageLoss& a) override { stages_->image_loss(last.image_loss = a); }
  void raster_backward(const RasterBackward& a) override {
    stages_->raster_backward(last.raster_backward = a);
  }
  void sum_slots(const SumSlots& a) override { stages_->sum_slots(last.sum_slots = a); }
  void project_backward(const ProjectBackward& a) override {
    stages_->project_backward(last.project_backward = a);
  }
  void regularise(const Regularise& a) override { stages_->regularise(last.regularise = a); }
  void adam(const AdamStep& a) override { stages_->adam(last.adam = a); }
  void learn(const Learn& a) override { stages_->learn(a); }
  std::uint32_t relocate(const Relocate& a) override { return stages_->relocate(last.relocate = a); }
  void grow(const Grow& a) override { stages_->grow(last.grow = a); }
  void add_noise(const AddNoise& a) override { stages_->add_noise(last.add_noise = a); }

  Stages& real() { return *stages_; }

  struct {
    ProjectForward project_forward;
    CountLists count_lists;
    BuildLists build_lists;
    RasterForward raster_forward;
    ImageLoss image_loss;
    RasterBackward raster_backward;
    SumSlots sum_slots;
    ProjectBackward project_backward;
    Regularise regularise;
    AdamStep adam;
    Relocate relocate;
    Grow grow;
    AddNoise add_noise;
  } last;

 private:
  std::unique_ptr<Stages> stages_;
};

}  // namespace ubs::bench
