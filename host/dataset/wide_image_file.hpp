// SPDX-License-Identifier: Apache-2.0
// StoredWideImage is a WideImage (host/scene/wide_image.hpp) whose pixels are read from a file on demand.
#pragma once

#include <memory>
#include <string>

#include "host/dataset/lens_image.hpp"
#include "host/scene/wide_image.hpp"

namespace ubs {

class StoredWideImage final : public WideImage {
 public:
  // `lens` is the lens for an image of the size that `source` delivers; `source` does not undistort the
  // image. `where` is the name of the image in messages. load(), faces() and compose() throw the errors of
  // LensImage.
  StoredWideImage(const WideLens& lens, std::string where, std::shared_ptr<const ImageSource> source)
      : lens_(lens), where_(std::move(where)), source_(std::move(source)) {}

  Image8 load() const override;
  std::vector<Camera> faces(const Camera& camera) const override { return lens_image().faces(camera); }
  RenderedView compose(std::span<const RenderedView> faces) const override {
    return lens_image().compose(faces);
  }
  const WideLens& lens() const { return lens_; }

 private:
  // Creates a new LensImage in each call. The object is not kept, because a data set may have thousands of
  // wide images, and only a few of them are used in measurements.
  LensImage lens_image() const { return LensImage(lens_, where_); }

  WideLens lens_;
  std::string where_;
  std::shared_ptr<const ImageSource> source_;
};

}  // namespace ubs
