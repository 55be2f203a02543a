// SPDX-License-Identifier: Apache-2.0
// OpencvParts gives access to OpenCV's functions for image files, and to FFmpeg's for videos. They depend on
// 220 libraries, which take five times as long to load as all other libraries of ubs
// (docs/results/2026-11-24-starts.md), and most commands do not need them. So these functions are in a
// separate module (opencv_module.cpp), which is loaded when opencv() is called for the first time.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "host/dataset/video_codec.hpp"

namespace ubs {

// OpencvParts contains pointers to functions. Those of OpenCV have the arguments that it defines, and throw
// its errors (cv::Exception).
struct OpencvParts {
  cv::Mat (*imdecode)(cv::InputArray file, int flags);
  bool (*imencode)(const cv::String& extension, cv::InputArray image, std::vector<uchar>& file,
                   const std::vector<int>& parameters);

  // These functions of video_codec.hpp throw std::runtime_error.
  std::unique_ptr<VideoDecoder> (*open_video_decoder)(const std::string& path);
  std::unique_ptr<VideoEncoder> (*open_video_encoder)(const VideoFormat& format, const std::string& path,
                                                      int width, int height, double fps);
};

// Returns the functions. The first call loads the module, and throws Error(data) if it cannot be loaded.
// Several threads may call this function at the same time.
const OpencvParts& opencv();

}  // namespace ubs
