// SPDX-License-Identifier: Apache-2.0
// These functions open the decoders and encoders of video_codec.hpp. Only the module calls them
// (opencv_module.cpp); other files call the pointers in OpencvParts.
#pragma once

#include <memory>
#include <string>

#include "host/dataset/video_codec.hpp"

namespace ubs {

std::unique_ptr<VideoDecoder> open_video_decoder(const std::string& path);
std::unique_ptr<VideoEncoder> open_video_encoder(const VideoFormat& format, const std::string& path,
                                                 int width, int height, double fps);

}  // namespace ubs
