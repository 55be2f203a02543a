// SPDX-License-Identifier: Apache-2.0
// Implements the fuzz targets for images, videos and masks. They decode files with OpenCV, TurboJPEG and
// libpng. Like the loader of training images, they also resize the images and apply masks.
#include <fcntl.h>
#include <unistd.h>

#include <opencv2/imgcodecs.hpp>

#include "host/dataset/image.hpp"
#include "host/dataset/resample.hpp"
#include "host/dataset/video.hpp"
#include "host/dataset/video_writer.hpp"
#include "tests/fuzz/files.hpp"

namespace ubs::fuzz {
namespace {

// Redirects stderr to /dev/null, because decoders print messages about each input.
class Quiet {
 public:
  Quiet() : before_(dup(2)) {
    const int nothing = open("/dev/null", O_WRONLY);
    dup2(nothing, 2);
    close(nothing);
  }
  ~Quiet() {
    dup2(before_, 2);
    close(before_);
  }
  Quiet(const Quiet&) = delete;

 private:
  int before_;
};

constexpr int kMaxPixels = 1 << 20;  // larger images are valid, but slow

// Adds an image with many different values to the seeds. `extension` selects the format, and `type` is the
// type of its pixels in OpenCV. Adds nothing if OpenCV has no encoder for them.
void add_encoded(std::vector<std::string>& seeds, const char* extension, int type) {
  cv::Mat image(6, 5, type);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols * image.channels(); ++x) {
      if (image.depth() == CV_32F)
        image.ptr<float>(y)[x] = 0.1f * static_cast<float>(x + y);
      else if (image.depth() == CV_16U)
        image.ptr<std::uint16_t>(y)[x] = static_cast<std::uint16_t>(1999 * x + 777 * y);
      else
        image.ptr<std::uint8_t>(y)[x] = static_cast<std::uint8_t>(29 * x + 7 * y);
    }
  std::vector<std::uint8_t> bytes;
  try {
    if (!cv::imencode(extension, image, bytes)) return;
  } catch (const cv::Exception&) {
    return;
  }
  seeds.emplace_back(1, '\0');
  seeds.back().append(bytes.begin(), bytes.end());
}

}  // namespace

// The input is one byte, followed by a file. If the first byte is odd, the file gets the extension .exr,
// otherwise .png.
void run_image(Data d) {
  if (d.empty()) return;
  const fs::path path = put(d[0] % 2 == 1 ? "x.exr" : "x.png", d.subspan(1));
  const Quiet quiet;
  expect_error_only([&] {
    const ImageSize size = image_file_size(path);
    if (size.width > kMaxPixels / std::max(size.height, 1)) return;
    const Image8 full = load_image(path, {1, 1, 1});
    Image8 image = resize_bicubic(full, downscaled(full.width, 2), downscaled(full.height, 2));
    set_mask(image, image);
  });
  expect_error_only([&] {
    const ImageSize size = image_file_size(path);
    if (size.width > kMaxPixels / std::max(size.height, 1)) return;
    const Image8 image = load_image(path);
    load_mask_image(path, image);
  });
}

std::vector<std::string> seed_image() {
  std::vector<std::string> seeds;
  for (const char* extension : {".png", ".jpg", ".webp", ".tif", ".bmp"})
    add_encoded(seeds, extension, CV_8UC3);
  add_encoded(seeds, ".png", CV_8UC4);
  add_encoded(seeds, ".png", CV_16UC1);
  add_encoded(seeds, ".tif", CV_16UC3);
  add_encoded(seeds, ".webp", CV_8UC4);
  add_encoded(seeds, ".exr", CV_32FC3);
  return seeds;
}

void run_video(Data d) {
  const fs::path path = put("x.avi", d);
  const Quiet quiet;
  expect_error_only([&] {
    const std::shared_ptr<VideoFile> video = open_video(path);
    const ImageSize size = video_size(*video);
    if (size.width > kMaxPixels / std::max(size.height, 1)) return;
    for (const int frame : {1, 0})
      if (frame < video_frames(*video))
        video_frame_source(video, frame, std::max(1, size.width / 2), std::max(1, size.height / 2))->load();
  });
}

std::vector<std::string> seed_video() {
  const fs::path path = folder() / "s.avi";
  VideoWriter writer(path, 16, 16, 10);
  for (int frame = 0; frame < 2; ++frame)
    writer.write({16, 16, std::vector<std::uint8_t>(16 * 16 * 3, static_cast<std::uint8_t>(60 * frame)), {}});
  writer.commit();
  return {get(path)};
}

}  // namespace ubs::fuzz
