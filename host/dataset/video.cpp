// SPDX-License-Identifier: Apache-2.0
// See video.hpp.
#include "host/dataset/video.hpp"

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <mutex>
#include <string_view>
#include <system_error>

#include "host/base/error.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/dataset/resample.hpp"

namespace ubs {
namespace {

// Returns whether the file is a container that holds the frames themselves. A file with any name may be a
// playlist that makes FFmpeg open other files or URLs. FFmpeg recognises the containers by the first bytes
// that are compared here, and no playlist starts with them.
bool holds_its_frames(const std::filesystem::path& path) {
  std::array<char, 400> start{};
  std::ifstream(path, std::ios::binary).read(start.data(), start.size());
  const std::string_view bytes(start.data(), start.size());
  const auto at = [&](std::size_t position, std::string_view word) {
    return bytes.substr(position, word.size()) == word;
  };
  if (at(0, "RIFF") && at(8, "AVI ")) return true;
  if (at(0, "\x1a\x45\xdf\xa3")) return true;  // Matroska, WebM
  for (const std::string_view atom : {"ftyp", "moov", "mdat", "wide", "free", "skip"})
    if (at(4, atom)) return true;         // MP4, MOV
  for (const std::size_t first : {0, 4})  // MPEG-TS: packets of 188 bytes, or of 192 with 4 leading bytes
    if (at(first, "G") && at(first + 188 + first, "G") && at(first + 2 * (188 + first), "G")) return true;
  return false;
}

}  // namespace

// VideoFile decodes the frames of a video file. Decoders can only seek to key frames. To go forward by a few
// frames, the frames in between are decoded. If seeking does not reach the requested frame, the file is
// decoded from its start.
class VideoFile {
 public:
  explicit VideoFile(std::filesystem::path path) : path_(std::move(path)) {
    if (!holds_its_frames(path_))
      fail(ErrorKind::data,
           "{}: cannot open the video: it is not an AVI, Matroska, MOV, MP4, MPEG-TS or WebM file",
           path_.string());
    open();
    size_ = {static_cast<int>(property(cv::CAP_PROP_FRAME_WIDTH)),
             static_cast<int>(property(cv::CAP_PROP_FRAME_HEIGHT))};
    const double frames = property(cv::CAP_PROP_FRAME_COUNT);
    if (size_.width < 1 || size_.height < 1 || size_.width > 65535 || size_.height > 65535 || !(frames >= 1))
      fail(ErrorKind::data, "{}: the video has no frames", path_.string());
    // If the size cannot be determined, it is the largest number. Reading the frames then reports the error.
    std::error_code ignored;
    const std::uintmax_t bytes = std::filesystem::file_size(path_, ignored);
    if (frames > static_cast<double>(bytes) || frames > std::numeric_limits<int>::max())
      fail(ErrorKind::data, "{}: the video is damaged: its header announces {:g} frames in {} bytes",
           path_.string(), frames, bytes);
    frames_ = static_cast<int>(frames);
  }

  Image8 frame(int index) {
    const std::lock_guard lock(mutex_);
    cv::Mat bgr;
    bool decoded = false;
    try {
      seek(index);
      decoded = capture_->read(bgr);
    } catch (const cv::Exception&) {  // OpenCV reports some damaged files in this way
    }
    if (!decoded || bgr.type() != CV_8UC3 || bgr.cols != size_.width || bgr.rows != size_.height)
      lose("cannot decode frame", index);
    next_ = index + 1;
    Image8 image{bgr.cols, bgr.rows, {}};
    image.rgb.reserve(static_cast<std::size_t>(bgr.cols) * static_cast<std::size_t>(bgr.rows) * 3);
    for (int y = 0; y < bgr.rows; ++y) {
      const unsigned char* in = bgr.ptr<unsigned char>(y);
      for (int x = 0; x < bgr.cols; ++x, in += 3) image.rgb.insert(image.rgb.end(), {in[2], in[1], in[0]});
    }
    return image;
  }

  ImageSize size() const { return size_; }
  int frames() const { return frames_; }

 private:
  static constexpr int kDecodeAhead = 60;  // maximum number of frames that are decoded instead of seeking

  void open() {
    capture_->release();
    try {
      // Only these two backends are used, because some others interpret file names as patterns, URLs or
      // pipelines.
      for (const int backend : {cv::CAP_FFMPEG, cv::CAP_OPENCV_MJPEG})
        if (!capture_->isOpened()) capture_->open(path_.string(), backend);
    } catch (const cv::Exception&) {
    }
    if (!capture_->isOpened()) fail(ErrorKind::data, "{}: cannot open the video", path_.string());
    next_ = 0;
  }

  // Returns a property of the open file, or 0 if OpenCV cannot determine it.
  double property(int id) const {
    try {
      return capture_->get(id);
    } catch (const cv::Exception&) {
      return 0;
    }
  }

  // Throws an error about a frame. Closes the file first, because the position of the decoder is unknown
  // after an error. The next call of frame() opens the file again, and so gets the right frame.
  [[noreturn]] void lose(const char* what, int index) {
    capture_->release();
    fail(ErrorKind::data, "{}: {} {}", path_.string(), what, index);
  }

  void seek(int index) {
    if (!capture_->isOpened()) open();
    if (index < next_ || index > next_ + kDecodeAhead) {
      capture_->set(cv::CAP_PROP_POS_FRAMES, index);
      if (static_cast<int>(capture_->get(cv::CAP_PROP_POS_FRAMES)) == index) {
        next_ = index;
      } else {
        open();
      }
    }
    for (; next_ < index; ++next_)
      if (!capture_->grab()) lose("the video ends before frame", index);
  }

  std::filesystem::path path_;
  std::mutex mutex_;
  cv::Ptr<cv::VideoCapture> capture_ = opencv().capture();
  ImageSize size_;
  int frames_ = 0, next_ = 0;
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
