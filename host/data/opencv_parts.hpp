// SPDX-License-Identifier: Apache-2.0
// OpenCV's codecs and videos. They bring 220 libraries, which take five times as long to load as all
// others (docs/results/2026-11-24-starts.md), and most commands need none of them: they are in a module of
// their own (opencv_module.cpp), which is loaded when one of them is called first.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

namespace ubs {

// Functions of OpenCV, with its names, arguments and errors (cv::Exception).
struct OpencvParts {
  cv::Mat (*imdecode)(cv::InputArray file, int flags);
  bool (*imencode)(const cv::String& extension, cv::InputArray image, std::vector<uchar>& file,
                   const std::vector<int>& parameters);

  // What else they do is virtual.
  cv::Ptr<cv::VideoCapture> (*capture)();
  cv::Ptr<cv::VideoWriter> (*writer)();
  bool (*open_writer)(cv::VideoWriter& writer, const cv::String& path, int backend, int fourcc, double fps,
                      cv::Size size);
};

// Loaded once, by any thread. Error(data) where the module cannot be loaded.
const OpencvParts& opencv();

}  // namespace ubs
