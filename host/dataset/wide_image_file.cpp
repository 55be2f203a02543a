// SPDX-License-Identifier: Apache-2.0
// See wide_image_file.hpp.
#include "host/dataset/wide_image_file.hpp"

namespace ubs {

Image8 StoredWideImage::load() const {
  Image8 image = source_->load();
  const std::vector<std::uint8_t> shown = lens_image().shown();
  if (image.mask.empty())
    image.mask = shown;
  else
    for (std::size_t i = 0; i < shown.size(); ++i) image.mask[i] &= shown[i];
  return image;
}

}  // namespace ubs
