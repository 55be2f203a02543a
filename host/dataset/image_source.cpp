// SPDX-License-Identifier: Apache-2.0
// See image_source.hpp.
#include "host/dataset/image_source.hpp"

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/resample.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

class FileSource : public ImageSource {
 public:
  explicit FileSource(FileImage image) : image_(std::move(image)) {}

  Image8 load() const override {
    const Image8 full = load_image(image_.path, image_.background);
    Image8 delivered = deliver(full);
    if (!image_.mask.empty()) set_mask(delivered, deliver(load_mask_image(image_.mask, full)));
    return delivered;
  }

 private:
  // Returns the pixels after undistortion and reduction.
  Image8 deliver(Image8 pixels) const {
    if (image_.undistortion) {
      const Lens& lens = image_.undistortion->lens;
      if (pixels.width != lens.width || pixels.height != lens.height)
        fail(ErrorKind::data, "{}: the image has {}x{} pixels, but had {}x{} when the data set was opened",
             image_.path.string(), pixels.width, pixels.height, lens.width, lens.height);
      pixels = undistort(pixels, *image_.undistortion);
    }
    if (pixels.width == image_.width && pixels.height == image_.height) return pixels;
    return resize_bicubic(pixels, image_.width, image_.height);
  }

  FileImage image_;
};

// CoveredSource is an image source that masks the pixels of a view that the original image does not cover.
class CoveredSource : public ImageSource {
 public:
  CoveredSource(std::shared_ptr<const ImageSource> inner, Undistortion plan)
      : inner_(std::move(inner)), plan_(std::move(plan)) {}

  Image8 load() const override {
    Image8 image = inner_->load();
    if (image.mask.empty()) image.mask.assign(sample_count(image.width, image.height, 1), 255);
    const double across = static_cast<double>(plan_.width) / image.width;
    const double down = static_cast<double>(plan_.height) / image.height;
    std::size_t at = 0;
    for (int j = 0; j < image.height; ++j)
      for (int i = 0; i < image.width; ++i, ++at)
        if (!covers(plan_, (i + 0.5) * across, (j + 0.5) * down)) image.mask[at] = 0;
    return image;
  }

 private:
  std::shared_ptr<const ImageSource> inner_;
  Undistortion plan_;
};

class CachedSource : public ImageSource {
 public:
  CachedSource(std::shared_ptr<const ImageSource> inner, fs::path file, int width, int height)
      : inner_(std::move(inner)), file_(std::move(file)), width_(width), height_(height) {}

  Image8 load() const override {
    if (path_exists(file_)) {
      try {
        Image8 image = load_image(file_);
        if (image.width == width_ && image.height == height_) return image;
        // A damaged file of the cache is replaced without a message, because nothing is lost.
      } catch (const std::exception&) {
      }
    }
    Image8 image = inner_->load();
    try {
      make_folders(file_.parent_path());
      save_png(file_, image, FileUse::cache);
    } catch (const std::exception& exception) {  // without the cache, loading only takes longer
      warn_once(fmt::format("images are not cached: {}", as_error(exception).what()));
    }
    return image;
  }

 private:
  std::shared_ptr<const ImageSource> inner_;
  fs::path file_;
  int width_, height_;
};

std::string describe(const FileImage& image) {
  std::string text = file_identity(image.path) + "|";
  text += fmt::format("|{},{},{}|{}x{}", image.background[0], image.background[1], image.background[2],
                      image.width, image.height);
  if (const auto& u = image.undistortion) {
    const Lens& l = u->lens;
    text += fmt::format("|{}|{}|{},{},{},{}|{}|{}x{}|{},{}", u->face,
                        l.formula ? l.formula->coefficients : "pinhole", l.fx, l.fy, l.cx, l.cy,
                        fmt::join(l.k, ","), u->width, u->height, u->cx, u->cy);
  }
  return text;
}

}  // namespace

std::string file_identity(const fs::path& path) {
  std::error_code ignored;  // reading the image reports the error
  const auto size = fs::file_size(path, ignored);
  const auto time = fs::last_write_time(path, ignored).time_since_epoch().count();
  return fmt::format("{}|{}|{}", fs::absolute(path, ignored).string(), size, time);
}

std::string cache_name(const std::string& description) {
  return fmt::format("{:016x}{:016x}.png", name_hash(description),
                     name_hash(description, 0x9ae16a3b2f90404fu));
}

std::shared_ptr<const ImageSource> file_image_source(FileImage image, const fs::path& cache_folder) {
  const std::string description = cache_folder.empty() ? "" : describe(image);
  const int width = image.width, height = image.height;
  // Only undistorted images without a mask are cached. Without undistortion, reading the file again is as
  // fast as reading the cache. The PNG files of the cache cannot store a mask.
  const bool expensive = image.undistortion.has_value() && image.mask.empty();
  const std::optional<Undistortion> plan = image.undistortion;
  std::shared_ptr<const ImageSource> source = std::make_shared<FileSource>(std::move(image));
  if (!cache_folder.empty() && expensive)
    source = cached_image_source(source, cache_folder / cache_name(description), width, height);
  if (!plan || plan->whole) return source;
  return std::make_shared<CoveredSource>(std::move(source), *plan);
}

std::shared_ptr<const ImageSource> cached_image_source(std::shared_ptr<const ImageSource> inner,
                                                       const fs::path& file, int width, int height) {
  return std::make_shared<CachedSource>(std::move(inner), file, width, height);
}

}  // namespace ubs
