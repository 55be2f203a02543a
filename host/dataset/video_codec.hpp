// SPDX-License-Identifier: Apache-2.0
// These classes decode and encode videos with the libraries of FFmpeg (libavformat, libavcodec, libswscale).
// They are implemented in the module that opencv_parts.hpp describes, so they only use the standard library.
// Errors are thrown as std::runtime_error, whose text does not contain the name of the file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace ubs {

// VideoPixels is a frame with three bytes per pixel (R, G, B) and without gaps between rows.
struct VideoPixels {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
};

// VideoDecoder reads the first video stream of a file. Only files of the containers AVI, Matroska, WebM, MP4,
// MOV and MPEG-TS are opened. Others, such as playlists, could make FFmpeg open other files or URLs.
class VideoDecoder {
 public:
  virtual ~VideoDecoder() = default;
  // The size of the frames as players show them: rotated as the display matrix of the file demands.
  virtual int width() const = 0;
  virtual int height() const = 0;
  // The number of frames, which are counted and not taken from the header.
  virtual int frames() const = 0;
  // What the file says about its pixels and frame() ignores; one sentence each.
  virtual const std::vector<std::string>& ignored() const = 0;
  // Decodes the frame with this number, in the order in which frames are shown. Colours are converted with
  // the matrix and the range that the stream states. A stream without a matrix uses that of BT.709 if the
  // frame is wider than 1279 or higher than 576 pixels, and otherwise that of BT.601, as in players. May be
  // called again after an error.
  virtual VideoPixels frame(int index) = 0;
};

// VideoFormat names a container and an encoder as FFmpeg does.
struct VideoFormat {
  const char* container;
  const char* encoder;
};

// VideoEncoder writes a file with one video stream. It states how colours are encoded.
class VideoEncoder {
 public:
  virtual ~VideoEncoder() = default;
  virtual void write(const std::vector<std::uint8_t>& rgb) = 0;
  virtual void finish() = 0;
};

}  // namespace ubs
