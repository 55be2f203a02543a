// SPDX-License-Identifier: Apache-2.0
// TrainingViews supplies the views for training. For each draw (the use of a view in an iteration), it
// determines the view, its camera and photograph at the current size (host/train/pyramid.hpp), and the loss
// of a render compared with the photograph. If requested, it also optimises the exposure and white balance of
// each photograph (method.md 4.9). Draws are counted from 0, with `batch` draws per iteration.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/train_settings.hpp"
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
  // Returns the number of training photographs. The views of a wide image count as one photograph.
  std::uint32_t images() const { return images_; }
  std::uint64_t batch() const { return batch_; }
  std::uint64_t first_draw(int iteration) const { return static_cast<std::uint64_t>(iteration - 1) * batch_; }
  std::uint32_t view_of(std::uint64_t draw) { return order_(draw); }
  // Returns `settings` with the background for a draw. This is View::background if the view has one.
  // Otherwise, if random_background is on, it is the mean of the given background and a random colour, which
  // differs for each draw.
  RenderSettings settings_of(std::uint64_t draw, RenderSettings settings);

  // Returns the factor by which training views are reduced at an iteration.
  int factor_at(const WorkShare& work, int iteration) const {
    return ubs::factor_at(levels_, work, iteration);
  }
  int factor() const { return factor_; }  // current factor
  // Sets the factor. If it differs from the current one, waits for the device and returns true. The cameras
  // of cameras() have then changed too.
  bool use_factor(int factor);
  // Returns the cameras of the training views at their current size, followed by the cameras of the test
  // views.
  std::vector<Camera> cameras() const;
  std::vector<Camera> test_cameras() const;  // the last part of cameras()
  Camera camera(std::uint32_t view) const { return reduced(whole_camera(view), factor_); }

  // Creates the refiner, so that the cameras of the training views can be refined. A test view that has the
  // same lens as a training view uses the refined lens.
  void refine_cameras(const SplatModel& initial) {
    refiner_.emplace(train_, initial, settings_.refine_cameras);
  }
  const CameraRefiner* refiner() const { return refiner_ ? &*refiner_ : nullptr; }
  void sweep_cameras(const Drawing& drawing, double done) { refiner_->sweep(drawing, factor_, done); }
  void set_refined(std::span<const double> state);

  // prefetch() starts to decode the image of a future draw, and upload() starts to copy it to the device.
  void prefetch(std::uint64_t draw) { targets_.prefetch(ahead_(draw)); }
  void upload(std::uint64_t draw) { targets_.upload(ahead_(draw)); }

  // Returns the operation that computes the loss of the rendered image and stores its gradient in the
  // renderer's v_image(). If the appearance is learnt, the operation first applies the colour map of the
  // photograph to the render.
  ImageLoss loss(const Renderer& renderer, std::uint64_t draw, BufferView<float> sums);
  // Takes an optimiser step for the appearance of the photograph of a draw. Does nothing if the appearance is
  // not learnt.
  void learn_appearance(Stages& stages, std::uint64_t draw, double rate, BufferView<std::uint32_t> sentinel,
                        std::uint32_t stamp);
  // Returns the gradients of the appearance for the views of a batch, one row per draw.
  BufferView<float> appearance_gradients() const { return v_appearance_.view(); }
  // These functions return and set TrainState::appearance.
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
  int factor_ = 1;  // current factor of the training views
  TargetImages targets_;
  ViewOrder order_, ahead_;  // ahead_ is used for future draws, which may be in the next epoch
  // Each photograph has its own appearance, which all views of a wide image share. appearance_ contains the
  // appearances of all photographs, and v_appearance_ the gradients of a batch. Both are empty if the
  // appearance is not learnt.
  std::vector<std::uint32_t> image_of_;  // number of the photograph of each view
  std::uint32_t images_;
  Buffer<float> appearance_, v_appearance_;
  std::optional<CameraRefiner> refiner_;
};

}  // namespace ubs
