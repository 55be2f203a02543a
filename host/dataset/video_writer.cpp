// SPDX-License-Identifier: Apache-2.0
// See video_writer.hpp.
#include "host/dataset/video_writer.hpp"

#include <exception>
#include <map>
#include <new>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/dataset/opencv_parts.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

// Codec is an encoder, and the name of the codec that ubs prints.
struct Codec {
  VideoFormat format;
  const char* name;
};

const std::map<std::string, std::vector<Codec>>& codecs() {
  static const auto h264_or_mpeg4 = [](const char* container) {
    return std::vector<Codec>{{{container, "libx264"}, "avc1"}, {{container, "mpeg4"}, "mp4v"}};
  };
  static const std::map<std::string, std::vector<Codec>> table{{".avi", {{{"avi", "mjpeg"}, "MJPG"}}},
                                                               {".m4v", h264_or_mpeg4("mp4")},
                                                               {".mkv", h264_or_mpeg4("matroska")},
                                                               {".mov", h264_or_mpeg4("mov")},
                                                               {".mp4", h264_or_mpeg4("mp4")}};
  return table;
}

struct OpenEncoder {
  std::unique_ptr<VideoEncoder> encoder;  // null if no encoder works
  std::string codec;
  std::string reason;  // why the last encoder did not work
};

// Opens the file with the first encoder that works.
OpenEncoder open_encoder(const fs::path& path, int width, int height, double fps) {
  OpenEncoder open;
  for (const Codec& codec : codecs().at(small_extension(path))) try {
      open.encoder = opencv().open_video_encoder(codec.format, path.string(), width, height, fps);
      open.codec = codec.name;
      return open;
    } catch (const Error&) {  // the module cannot be loaded
      throw;
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const std::exception& error) {
      open.reason = error.what();
    }
  return open;
}

}  // namespace

std::vector<std::string> video_extensions() {
  std::vector<std::string> names;
  for (const auto& [extension, unused] : codecs()) names.push_back(extension);
  return names;
}

std::string writable_videos() {
  std::vector<std::string> found;
  const TemporaryFolder folder;  // encoders follow links, so only this user may write there
  for (const auto& [extension, unused] : codecs()) {
    const std::string codec = open_encoder(folder.path() / ("probe" + extension), 64, 64, 25).codec;
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
  OpenEncoder open = open_encoder(file_->temporary(), width, height, fps);
  encoder_ = std::move(open.encoder), codec_ = open.codec;
  if (encoder_) return;
  const std::string possible = writable_videos();
  fail(ErrorKind::data,
       "{}: cannot write this video: the folder is not writable, or there is no encoder for {} ({}); "
       "available "
       "encoders: {}; to write images instead, use --out",
       path_.string(), path_.extension().string(), open.reason, possible.empty() ? "none" : possible);
}

VideoWriter::~VideoWriter() = default;

void VideoWriter::attempt(const std::function<void()>& function) const {
  try {
    function();
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    fail(ErrorKind::data, "{}: frame {}: {}", path_.string(), frames_, error.what());
  }
}

void VideoWriter::write(const Image8& frame) {
  if (frame.width != width_ || frame.height != height_)
    fail(ErrorKind::internal, "{}: the frame has {}x{} pixels, but the video has {}x{}", path_.string(),
         frame.width, frame.height, width_, height_);
  attempt([&] { encoder_->write(frame.rgb); });
  ++frames_;
}

void VideoWriter::commit() {
  if (frames_ == 0) fail(ErrorKind::internal, "{}: a video must have at least one frame", path_.string());
  attempt([&] { encoder_->finish(); });
  encoder_.reset();
  file_->commit();
}

}  // namespace ubs
