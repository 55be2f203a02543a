// SPDX-License-Identifier: Apache-2.0
// The views of a training: which one comes at which draw, at what size its camera and photograph are now
// (host/train/pyramid.hpp), the loss against the photograph, and where wanted the photograph's own exposure
// and white balance, which are learnt (method.md 4.9). Draws count from 0, `batch` an iteration.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/camera_refiner.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/target_images.hpp"
#include "host/train/view_order.hpp"

namespace ubs {

class TrainingViews {
 public:
  // Settings and splits must outlive the object; `train` must not be empty.
  TrainingViews(Device& device, const TrainSettings& settings, const Split& train, const Split& test);

  const Split& train() const { return train_; }
  const Split& test() const { return test_; }
  TargetImages& targets() { return targets_; }
  std::uint64_t batch() const { return batch_; }
  std::uint64_t first_draw(int iteration) const { return static_cast<std::uint64_t>(iteration - 1) * batch_; }
  std::uint32_t view_of(std::uint64_t draw) { return order_(draw); }
  // `settings` with what is behind the view of a draw: another colour each time where the background is
  // random.
  RenderSettings settings_of(std::uint64_t draw, RenderSettings settings) const;

  // The factor by which training views are reduced at an iteration.
  int factor_at(const WorkShare& work, int iteration) const {
    return ubs::factor_at(levels_, work, iteration);
  }
  int factor() const { return factor_; }  // as they are reduced now
  // True when another size of the training views begins: cameras() has changed. Waits then.
  bool use_factor(int factor);
  // Of the training views as they are trained now, then of the test views.
  std::vector<Camera> cameras() const;
  std::vector<Camera> test_cameras() const;  // their last part
  Camera camera(std::uint32_t view) const { return reduced(whole_camera(view), factor_); }

  // From now on the cameras of the training views are refined; test views share their lens.
  void refine_cameras(const SplatModel& initial) {
    refiner_.emplace(train_, initial, settings_.refine_cameras);
  }
  const CameraRefiner* refiner() const { return refiner_ ? &*refiner_ : nullptr; }
  void sweep_cameras(const Drawing& drawing, double done) { refiner_->sweep(drawing, factor_, done); }
  void set_refined(std::span<const double> state);

  // Starts to decode, and to copy to the device, what a draw to come will want.
  void prefetch(std::uint64_t draw) { targets_.prefetch(ahead_(draw)); }
  void upload(std::uint64_t draw) { targets_.upload(ahead_(draw)); }

  // The loss of what the renderer has drawn and its gradient into the renderer's v_image(), after the
  // photograph's own appearance where that is learnt.
  ImageLoss loss(const Renderer& renderer, std::uint64_t draw, BufferView<float> sums);
  // The step of the appearance of a draw's photograph; nothing where it is not learnt.
  void learn_appearance(Stages& stages, std::uint64_t draw, double rate, BufferView<std::uint32_t> sentinel,
                        std::uint32_t stamp);
  BufferView<float> appearance_gradients() const { return v_appearance_.view(); }  // of a batch, by draw
  std::vector<float> appearance() const;
  void set_appearance(std::span<const float> values);

 private:
  std::uint32_t appearance_slot(std::uint64_t draw) const {
    return static_cast<std::uint32_t>(draw % batch_) * kAppearanceNumbers;
  }

  const Camera& whole_camera(std::uint32_t view) const {
    return refiner_ ? refiner_->cameras()[view] : train_.views[view].camera;
  }

  const TrainSettings& settings_;
  const Split& train_;
  const Split& test_;
  const std::uint64_t batch_;
  const std::vector<PyramidLevel> levels_;
  int factor_ = 1;  // of the cameras and targets as they are now
  TargetImages targets_;
  ViewOrder order_, ahead_;                  // the second one looks ahead across the end of an epoch
  Buffer<float> appearance_, v_appearance_;  // of all photographs, of a batch; empty where it is not learnt
  std::optional<CameraRefiner> refiner_;
};

}  // namespace ubs
