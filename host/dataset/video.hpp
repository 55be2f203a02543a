// SPDX-License-Identifier: Apache-2.0
// These functions open video files and make image sources that deliver their frames, decoded by FFmpeg's
// libraries (video_codec.hpp).
#pragma once

#include <array>
#include <filesystem>
#include <memory>

#include "host/dataset/image.hpp"

namespace ubs {

class VideoFile;  // a decoder, which frame sources of several threads may share

std::shared_ptr<VideoFile> open_video(const std::filesystem::path& path);
ImageSize video_size(const VideoFile& video);
int video_frames(const VideoFile& video);  // counted

// Returns a source of frame `index`, resized to width x height by Pillow's bicubic filter if necessary.
std::shared_ptr<const ImageSource> video_frame_source(std::shared_ptr<VideoFile> video, int index, int width,
                                                      int height);

}  // namespace ubs
