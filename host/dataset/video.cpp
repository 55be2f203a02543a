// SPDX-License-Identifier: Apache-2.0
// See video.hpp.
#include "host/dataset/video.hpp"

#include <exception>
#include <mutex>
#include <new>
#include <utility>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/dataset/resample.hpp"

namespace ubs {

class VideoFile {
 public:
  explicit VideoFile(std::filesystem::path path) : path_(std::move(path)) {
    attempt("", [&] { decoder_ = opencv().open_video_decoder(path_.string()); });
    for (const std::string& note : decoder_->ignored())
      warn_once(fmt::format("{}: {}", path_.string(), note));
  }

  Image8 frame(int index) {
    const std::lock_guard lock(mutex_);
    VideoPixels pixels;
    attempt(fmt::format("cannot decode frame {}: ", index), [&] { pixels = decoder_->frame(index); });
    return {pixels.width, pixels.height, std::move(pixels.rgb)};
  }

  ImageSize size() const { return {decoder_->width(), decoder_->height()}; }
  int frames() const { return decoder_->frames(); }

 private:
  // Calls a function of the decoder and puts the name of the file in front of its errors.
  template <typename Function>
  void attempt(const std::string& what, const Function& function) const {
    try {
      function();
    } catch (const Error&) {  // the module cannot be loaded
      throw;
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const std::exception& error) {
      fail(ErrorKind::data, "{}: {}{}", path_.string(), what, error.what());
    }
  }

  std::filesystem::path path_;
  std::mutex mutex_;
  std::unique_ptr<VideoDecoder> decoder_;
};

namespace {

class FrameSource : public ImageSource {
 public:
  FrameSource(std::shared_ptr<VideoFile> video, int index, int width, int height)
      : video_(std::move(video)), index_(index), width_(width), height_(height) {}

  Image8 load() const override {
    Image8 image = video_->frame(index_);
    if (image.width == width_ && image.height == height_) return image;
    return resize_bicubic(image, width_, height_);
  }

 private:
  std::shared_ptr<VideoFile> video_;
  int index_, width_, height_;
};

}  // namespace

std::shared_ptr<VideoFile> open_video(const std::filesystem::path& path) {
  return std::make_shared<VideoFile>(path);
}
ImageSize video_size(const VideoFile& video) { return video.size(); }
int video_frames(const VideoFile& video) { return video.frames(); }

std::shared_ptr<const ImageSource> video_frame_source(std::shared_ptr<VideoFile> video, int index, int width,
                                                      int height) {
  return std::make_shared<FrameSource>(std::move(video), index, width, height);
}

}  // namespace ubs
