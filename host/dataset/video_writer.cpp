// SPDX-License-Identifier: Apache-2.0
// See video_writer.hpp.
#include "host/dataset/video_writer.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <opencv2/core/utils/logger.hpp>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/dataset/video.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::vector<std::string>>& codecs() {
  static const std::map<std::string, std::vector<std::string>> table{{".avi", {"MJPG"}},
                                                                     {".m4v", {"avc1", "mp4v"}},
                                                                     {".mkv", {"avc1", "mp4v", "MJPG"}},
                                                                     {".mov", {"avc1", "mp4v"}},
                                                                     {".mp4", {"avc1", "mp4v"}}};
  return table;
}

// QuietOpencv is an object that silences the log of OpenCV as long as it exists.
class QuietOpencv {
 public:
  QuietOpencv() : level_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~QuietOpencv() { cv::utils::logging::setLogLevel(level_); }
  QuietOpencv(const QuietOpencv&) = delete;

 private:
  cv::utils::logging::LogLevel level_;
};

// Opens the file with the first codec that works. Returns the name of this codec, or an empty string if none
// works.
std::string open_writer(cv::VideoWriter& writer, const fs::path& path, int width, int height, double fps) {
  const QuietOpencv quiet;
  for (const std::string& codec : codecs().at(small_extension(path))) {
    int code = 0;
    for (int i = 0; i < 4; ++i) code |= codec[static_cast<std::size_t>(i)] << 8 * i;
    for (const int backend : {cv::CAP_FFMPEG, cv::CAP_OPENCV_MJPEG}) {
      if (backend == cv::CAP_OPENCV_MJPEG && small_extension(path) != ".avi") continue;
      try {
        if (opencv().open_writer(writer, path.string(), backend, code, fps, {width, height})) return codec;
        // An encoder that refuses the file is treated as missing.
      } catch (const cv::Exception&) {
      }
    }
  }
  return "";
}

// Returns why no more bytes can be appended to the file, or an empty string if they can. The file stays as it
// was. This finds out whether a disk has become full while OpenCV wrote to it, because OpenCV does not report
// that.
std::string full_disk(const fs::path& file) {
  const std::uintmax_t bytes = fs::file_size(file);
  std::ofstream stream(file, std::ios::binary | std::ios::app);
  errno = 0;
  const bool grew = static_cast<bool>(stream << std::string(std::size_t{1} << 13, '\0') << std::flush);
  const std::string reason = grew ? "" : std::strerror(errno);
  stream.close();
  std::error_code error;
  fs::resize_file(file, bytes, error);
  return error ? error.message() : reason;
}

}  // namespace

struct VideoWriter::Encoder {
  cv::Ptr<cv::VideoWriter> writer = opencv().writer();
};

std::vector<std::string> video_extensions() {
  std::vector<std::string> names;
  for (const auto& [extension, unused] : codecs()) names.push_back(extension);
  return names;
}

std::string writable_videos() {
  std::vector<std::string> found;
  const TemporaryFolder folder;  // encoders follow links, so only this user may write there
  for (const auto& [extension, unused] : codecs()) {
    const cv::Ptr<cv::VideoWriter> writer = opencv().writer();
    const std::string codec = open_writer(*writer, folder.path() / ("probe" + extension), 64, 64, 25);
    writer->release();
    if (!codec.empty()) found.push_back(fmt::format("{} ({})", extension, codec));
  }
  return fmt::format("{}", fmt::join(found, ", "));
}

VideoWriter::VideoWriter(fs::path path, int width, int height, double fps)
    : path_(std::move(path)), width_(width), height_(height) {
  if (!codecs().contains(small_extension(path_)))
    fail(ErrorKind::usage, "{}: the name of a video must end with one of {}", path_.string(),
         fmt::join(video_extensions(), ", "));
  if (width < 16 || height < 16 || width > 16384 || height > 16384 || width % 2 != 0 || height % 2 != 0)
    fail(ErrorKind::usage, "{}: video frames must have an even width and height from 16 to 16384, not {}x{}",
         path_.string(), width, height);
  if (!(fps > 0 && fps <= 1000))
    fail(ErrorKind::usage, "{}: {} frames per second are not supported: choose a rate above 0 and up to 1000",
         path_.string(), fps);
  const fs::path folder = path_.has_parent_path() ? path_.parent_path() : fs::path(".");
  if (!is_folder(folder)) fail(ErrorKind::data, "{}: the folder does not exist", folder.string());
  if (is_folder(path_)) fail(ErrorKind::data, "{}: this is a folder", path_.string());
  file_ = std::make_unique<AtomicFile>(path_, FileUse::result, small_extension(path_));
  encoder_ = std::make_unique<Encoder>();
  codec_ = open_writer(*encoder_->writer, file_->temporary(), width, height, fps);
  if (!codec_.empty()) return;
  const std::string possible = writable_videos();
  fail(ErrorKind::data,
       "{}: cannot write this video: the folder is not writable, or OpenCV has no encoder for {}; available "
       "encoders: {}; to write images instead, use --out",
       path_.string(), path_.extension().string(), possible.empty() ? "none" : possible);
}

VideoWriter::~VideoWriter() {
  if (encoder_) encoder_->writer->release();
}

void VideoWriter::write(const Image8& frame) {
  if (frame.width != width_ || frame.height != height_)
    fail(ErrorKind::internal, "{}: the frame has {}x{} pixels, but the video has {}x{}", path_.string(),
         frame.width, frame.height, width_, height_);
  cv::Mat bgr(frame.height, frame.width, CV_8UC3);
  for (std::size_t i = 0; i < frame.rgb.size(); i += 3)
    for (std::size_t c = 0; c < 3; ++c) bgr.data[i + c] = frame.rgb[i + 2 - c];
  try {
    encoder_->writer->write(bgr);
  } catch (const cv::Exception& error) {
    fail(ErrorKind::data, "{}: the encoder failed at frame {}: {}", path_.string(), frames_, error.err);
  }
  ++frames_;
}

void VideoWriter::commit() {
  encoder_->writer->release();
  const auto incomplete = [&](int found) {
    fail(ErrorKind::data, "{}: only {} of {} frames were written: the disk may be full", path_.string(),
         found, frames_);
  };
  int found = 0;
  try {
    const QuietOpencv quiet;
    found = video_frames(*open_video(file_->temporary()));
  } catch (const Error&) {
    incomplete(0);
  }
  if (found != frames_) incomplete(found);
  if (const std::string reason = full_disk(file_->temporary()); !reason.empty())
    fail(ErrorKind::data, "{}: not written completely: {}", path_.string(), reason);
  file_->commit();
  encoder_.reset();
}

}  // namespace ubs
