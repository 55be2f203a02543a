// SPDX-License-Identifier: Apache-2.0
// VideoWriter writes video files with the libraries of FFmpeg. The extension of the file determines which
// codecs are tried, and the first codec for which an encoder is available is used. For .mp4, .m4v, .mov and
// .mkv these are H.264 and MPEG-4; for .avi it is Motion JPEG. The available encoders are determined at run
// time. The files state how colours are encoded (video_codec.hpp).
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

class AtomicFile;
class VideoEncoder;

// Returns the extensions (".mp4" and so on) that VideoWriter accepts, whether or not an encoder is available.
std::vector<std::string> video_extensions();
// Returns the formats that this machine can write, such as ".avi (MJPG), .mp4 (avc1)". The function tries all
// formats in a temporary folder.
std::string writable_videos();

// VideoWriter encodes frames into a temporary file, and commit() gives this file its name. So the file does
// not appear under its name before it is complete.
class VideoWriter {
 public:
  // The width and the height must be even numbers from 16 to 16384, and `fps` must be above 0 and at most
  // 1000. Throws Error(usage) for other sizes and rates, and for unknown extensions. Throws Error(data) if
  // the folder does not exist, or if no encoder accepts the file; in this case the message lists the formats
  // that can be written.
  VideoWriter(std::filesystem::path path, int width, int height, double fps);
  ~VideoWriter();
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  // Encodes the next frame.
  void write(const Image8& frame);
  // Completes the file and gives it its name. Throws Error(data) if it could not be written completely.
  void commit();
  const std::string& codec() const { return codec_; }

 private:
  // Calls a function of the encoder. Its errors get the name of the file and the number of the frame.
  void attempt(const std::function<void()>& function) const;

  std::filesystem::path path_;
  std::string codec_;
  int width_, height_, frames_ = 0;
  std::unique_ptr<AtomicFile> file_;
  std::unique_ptr<VideoEncoder> encoder_;
};

}  // namespace ubs
