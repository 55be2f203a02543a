// SPDX-License-Identifier: Apache-2.0
// Frames of a video file as image sources (OpenCV decodes).
#pragma once

#include <array>
#include <filesystem>
#include <memory>

#include "host/data/image.hpp"

namespace ubs {

class VideoFile;  // one decoder, used by one thread at a time

std::shared_ptr<VideoFile> open_video(const std::filesystem::path& path);
ImageSize video_size(const VideoFile& video);
int video_frames(const VideoFile& video);  // as the container says

// Frame `index`, reduced to width x height by Pillow's bicubic where that differs.
std::shared_ptr<const ImageSource> video_frame_source(std::shared_ptr<VideoFile> video, int index, int width,
                                                      int height);

}  // namespace ubs
