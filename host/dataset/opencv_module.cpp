// SPDX-License-Identifier: Apache-2.0
// This file and video_module.cpp are the loadable module with the functions of opencv_parts.hpp.
#include <opencv2/imgcodecs.hpp>

#include "host/dataset/opencv_parts.hpp"
#include "host/dataset/video_module.hpp"

extern "C" const ubs::OpencvParts* ubs_opencv_parts() {
  static const ubs::OpencvParts parts{.imdecode = cv::imdecode,
                                      .imencode = cv::imencode,
                                      .open_video_decoder = ubs::open_video_decoder,
                                      .open_video_encoder = ubs::open_video_encoder};
  return &parts;
}
