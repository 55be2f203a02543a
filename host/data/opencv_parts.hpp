// SPDX-License-Identifier: Apache-2.0
// OpencvParts gives access to OpenCV's codecs and videos. These depend on 220 libraries, which take five
// times as long to load as all others (docs/results/2026-11-24-starts.md), and most commands do not need
// them. So they are in a module of their own (opencv_module.cpp), which is loaded at the first call.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

namespace ubs {

// Functions of OpenCV, with its names, arguments and errors (cv::Exception).
struct OpencvParts {
  cv::Mat (*imdecode)(cv::InputArray file, int flags);
  bool (*imencode)(const cv::String& extension, cv::InputArray image, std::vector<uchar>& file,
                   const std::vector<int>& parameters);

  // The other functions of these classes are virtual and need no entry here.
  cv::Ptr<cv::VideoCapture> (*capture)();
  cv::Ptr<cv::VideoWriter> (*writer)();
  bool (*open_writer)(cv::VideoWriter& writer, const cv::String& path, int backend, int fourcc, double fps,
                      cv::Size size);
};

// Loads the module at the first call. Thread-safe. Throws Error(data) if the module cannot be loaded.
const OpencvParts& opencv();

}  // namespace ubs
