// SPDX-License-Identifier: Apache-2.0
// This file is the loadable module with the functions of opencv_parts.hpp.
#include <opencv2/imgcodecs.hpp>

#include "host/dataset/opencv_parts.hpp"

extern "C" const ubs::OpencvParts* ubs_opencv_parts() {
  static const ubs::OpencvParts parts{
      .imdecode = cv::imdecode,
      .imencode = cv::imencode,
      .capture = [] { return cv::makePtr<cv::VideoCapture>(); },
      .writer = [] { return cv::makePtr<cv::VideoWriter>(); },
      .open_writer = [](cv::VideoWriter& writer, const cv::String& path, int backend, int fourcc, double fps,
                        cv::Size size) { return writer.open(path, backend, fourcc, fps, size, true); }};
  return &parts;
}
