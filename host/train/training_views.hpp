// SPDX-License-Identifier: Apache-2.0
// TrainingViews supplies the views of a training: which view is used at each draw, its camera and photograph
// at the present size (host/train/pyramid.hpp), and the loss against the photograph. If requested, it also
// optimises the exposure and white balance of each photograph (method.md 4.9). Draws are counted from 0, with
// `batch` draws per iteration.
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
  std::uint32_t images() const { return images_; }  // number of training photographs
  std::uint64_t batch() const { return batch_; }
  std::uint64_t first_draw(int iteration) const { return static_cast<std::uint64_t>(iteration - 1) * batch_; }
  std::uint32_t view_of(std::uint64_t draw) { return order_(draw); }
  // Returns `settings` with the background for a draw: that of the view (View::background) or, if the
  // background is random, a different colour for each draw.
  RenderSettings settings_of(std::uint64_t draw, RenderSettings settings);

  // Returns the factor by which training views are reduced at an iteration.
  int factor_at(const WorkShare& work, int iteration) const {
    return ubs::factor_at(levels_, work, iteration);
  }
  int factor() const { return factor_; }  // present factor
  // Sets the factor. Returns true if it has changed. In this case cameras() has changed too, and the call
  // waits for the device.
  bool use_factor(int factor);
  // Returns the cameras of the training views at their present size, followed by those of the test views.
  std::vector<Camera> cameras() const;
  std::vector<Camera> test_cameras() const;  // the last part of cameras()
  Camera camera(std::uint32_t view) const { return reduced(whole_camera(view), factor_); }

  // Starts to refine the cameras of the training views. Test views use the refined lens that they share with
  // training views.
  void refine_cameras(const SplatModel& initial) {
    refiner_.emplace(train_, initial, settings_.refine_cameras);
  }
  const CameraRefiner* refiner() const { return refiner_ ? &*refiner_ : nullptr; }
  void sweep_cameras(const Drawing& drawing, double done) { refiner_->sweep(drawing, factor_, done); }
  void set_refined(std::span<const double> state);

  // prefetch() starts to decode the image of a future draw, and upload() starts to copy it to the device.
  void prefetch(std::uint64_t draw) { targets_.prefetch(ahead_(draw)); }
  void upload(std::uint64_t draw) { targets_.upload(ahead_(draw)); }

  // Returns the operation that computes the loss of the rendered image, and its gradient into the renderer's
  // v_image(). If the appearance is learnt, it maps the render by the appearance of the photograph first.
  ImageLoss loss(const Renderer& renderer, std::uint64_t draw, BufferView<float> sums);
  // Takes an optimiser step for the appearance of the photograph of a draw. Does nothing if the appearance is
  // not learnt.
  void learn_appearance(Stages& stages, std::uint64_t draw, double rate, BufferView<std::uint32_t> sentinel,
                        std::uint32_t stamp);
  // Returns the gradients of a batch, indexed by draw.
  BufferView<float> appearance_gradients() const { return v_appearance_.view(); }
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
  int factor_ = 1;  // present factor of the cameras and targets
  TargetImages targets_;
  ViewOrder order_, ahead_;  // ahead_ is used for future draws, which may be in the next epoch
  // The appearance belongs to a photograph, so the views of a wide image share one. appearance_ is that of
  // all photographs, and v_appearance_ is the gradient of a batch. Both are empty if the appearance is not
  // learnt.
  std::vector<std::uint32_t> image_of_;  // number of the photograph of each view
  std::uint32_t images_;
  Buffer<float> appearance_, v_appearance_;
  std::optional<CameraRefiner> refiner_;
};

}  // namespace ubs
