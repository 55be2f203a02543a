// SPDX-License-Identifier: Apache-2.0
// Video files out (OpenCV encodes). The extension decides: .mp4, .m4v, .mov (H.264, else MPEG-4), .mkv
// (H.264, MPEG-4, else Motion JPEG), .avi (Motion JPEG). Which encoders there are is found out at run time.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

class AtomicFile;

// Extensions, ".mp4" and so on, that VideoWriter takes, whether or not there is an encoder.
std::vector<std::string> video_extensions();
// "avi (MJPG), mp4 (avc1)": those that this machine can write, tried out in a temporary folder.
std::string writable_videos();

// An AtomicFile that an encoder writes: nothing of that name until commit().
class VideoWriter {
 public:
  // Even sizes from 16 on, fps in (0, 1000]. Throws Error(usage) for other extensions, sizes and rates, and
  // Error(data), naming what can be written, when no encoder takes the file.
  VideoWriter(std::filesystem::path path, int width, int height, double fps);
  ~VideoWriter();
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  void write(const Image8& frame);
  // Throws Error(data) when the file does not hold every frame written: encoders do not report a full disk.
  void commit();
  const std::string& codec() const { return codec_; }

 private:
  struct Encoder;
  std::filesystem::path path_;
  std::string codec_;
  int width_, height_, frames_ = 0;
  std::unique_ptr<AtomicFile> file_;
  std::unique_ptr<Encoder> encoder_;
};

}  // namespace ubs
