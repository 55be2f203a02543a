// SPDX-License-Identifier: Apache-2.0
// VideoWriter writes video files with OpenCV. The extension determines the codec; the first of these that is
// available is used: H.264 or MPEG-4 for .mp4, .m4v and .mov; H.264, MPEG-4 or Motion JPEG for .mkv; Motion
// JPEG for .avi. The available encoders are determined at run time.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

class AtomicFile;

// Returns the extensions (".mp4" and so on) that VideoWriter accepts, whether or not an encoder is available.
std::vector<std::string> video_extensions();
// Returns the formats that this machine can write, such as "avi (MJPG), mp4 (avc1)". Tries them in a
// temporary folder.
std::string writable_videos();

// VideoWriter is like AtomicFile, but an encoder writes the file. The file does not appear under its name
// before commit().
class VideoWriter {
 public:
  // Requires even sizes of at least 16 and fps in (0, 1000]. Throws Error(usage) for other extensions, sizes
  // and rates. Throws Error(data) that names the possible formats if no encoder accepts the file.
  VideoWriter(std::filesystem::path path, int width, int height, double fps);
  ~VideoWriter();
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  void write(const Image8& frame);
  // Throws Error(data) if the file does not contain all frames written, because encoders do not report a full
  // disk.
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
