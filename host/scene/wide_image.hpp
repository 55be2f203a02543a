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
  // Returns the image. Its mask excludes the pixels that compose() does not determine, or determines only in
  // part.
  virtual Image8 load() const = 0;
  // Returns the pinhole cameras whose renders compose() needs, in the same order. They have the pose and the
  // query values of `camera`, which is the camera of the image.
  virtual std::vector<Camera> faces(const Camera& camera) const = 0;
  virtual RenderedView compose(std::span<const RenderedView> faces) const = 0;
};

// Returns the pose of the camera of the wide image, given the camera of a view that shows a part of it.
inline Camera camera_of_wide_image(const View& view, Camera camera) {
  const RotationMatrix back = transposed(view.turn_in_wide);
  camera.rotation = product(back, camera.rotation);
  camera.translation = rotated(back, camera.translation);
  return camera;
}

}  // namespace ubs
