// SPDX-License-Identifier: Apache-2.0
// WideImage is an image that shows more than a pinhole camera can, such as a fisheye image or a panorama.
// Training uses views that show parts of it (View::wide). To compare a model with the image itself, compose()
// makes an image with the same lens from renders of pinhole cameras.
#pragma once

#include <span>
#include <vector>

#include "host/base/vector3.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/rendered_view.hpp"

namespace ubs {

class WideImage {
 public:
  virtual ~WideImage() = default;
  // Returns the image. Its mask excludes the pixels that compose() cannot compute, or for which it only has a
  // part of the samples.
  virtual Image8 load() const = 0;
  // Returns the pinhole cameras whose renders compose() needs, in the order in which compose() expects them.
  // They have the position and the query values of `camera`, which is the camera of the image, and look in
  // different directions.
  virtual std::vector<Camera> faces(const Camera& camera) const = 0;
  // Returns an image with the lens of this image, computed from the renders of the cameras of faces().
  virtual RenderedView compose(std::span<const RenderedView> faces) const = 0;
};

// Returns `camera` with the pose of the wide image. `camera` must have the pose of `view`, which shows a part
// of the wide image.
inline Camera camera_of_wide_image(const View& view, Camera camera) {
  const RotationMatrix back = transposed(view.turn_in_wide);
  camera.rotation = product(back, camera.rotation);
  camera.translation = rotated(back, camera.translation);
  return camera;
}

}  // namespace ubs
