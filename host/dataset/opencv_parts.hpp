// SPDX-License-Identifier: Apache-2.0
// OpencvParts gives access to OpenCV's functions for image files and videos. They depend on 220 libraries,
// which take five times as long to load as all other libraries of ubs (docs/results/2026-11-24-starts.md),
// and most commands do not need them. So these functions are in a separate module (opencv_module.cpp), which
// is loaded when opencv() is called for the first time.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

namespace ubs {

// OpencvParts contains pointers to functions of OpenCV. They have the arguments that OpenCV defines, and
// throw its errors (cv::Exception).
struct OpencvParts {
  cv::Mat (*imdecode)(cv::InputArray file, int flags);
  bool (*imencode)(const cv::String& extension, cv::InputArray image, std::vector<uchar>& file,
                   const std::vector<int>& parameters);

  // These functions create and open objects of OpenCV's video classes. All other functions of these classes
  // that ubs calls are virtual, so they need no entry here.
  cv::Ptr<cv::VideoCapture> (*capture)();
  cv::Ptr<cv::VideoWriter> (*writer)();
  bool (*open_writer)(cv::VideoWriter& writer, const cv::String& path, int backend, int fourcc, double fps,
                      cv::Size size);
};

// Returns the functions. The first call loads the module, and throws Error(data) if it cannot be loaded.
// Several threads may call this function at the same time.
const OpencvParts& opencv();

}  // namespace ubs
