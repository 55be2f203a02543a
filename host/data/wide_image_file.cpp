// SPDX-License-Identifier: Apache-2.0
#include "host/data/wide_image_file.hpp"

#include "host/data/image.hpp"

namespace ubs {
namespace {

class FileWideImage : public WideImage {
 public:
  FileWideImage(const WideLens& lens, const FileImage& image)
      : lens_(lens), file_(image.path.string()), source_(file_image_source(image)) {}

  Image8 load() const override {
    Image8 image = source_->load();
    const std::vector<std::uint8_t> shown = lens_image().shown();
    if (image.mask.empty())
      image.mask = shown;
    else
      for (std::size_t i = 0; i < shown.size(); ++i) image.mask[i] &= shown[i];
    return image;
  }
  std::vector<Camera> faces(const Camera& camera) const override { return lens_image().faces(camera); }
  RenderedView compose(std::span<const RenderedView> faces) const override {
    return lens_image().compose(faces);
  }

 private:
  // Creates a LensImage for each call instead of keeping it, because a data set may have thousands of wide
  // images, of which only a few are measured.
  LensImage lens_image() const { return LensImage(lens_, file_); }

  WideLens lens_;
  std::string file_;
  std::shared_ptr<const ImageSource> source_;
};

}  // namespace

std::shared_ptr<const WideImage> wide_image(const WideLens& lens, const FileImage& image) {
  return std::make_shared<FileWideImage>(lens, image);
}

}  // namespace ubs
