// SPDX-License-Identifier: Apache-2.0
// This file contains functions of host/model/picture.hpp and of host/dataset/video_writer.hpp for builds
// without OpenCV (UBS_OPENCV=OFF). Such a build can render views to image files, but cannot write videos.
// Therefore the functions throw an error, except video_extensions(), whose result is a part of a message.
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/dataset/video_codec.hpp"
#include "host/dataset/video_writer.hpp"
#include "host/model/picture.hpp"

namespace ubs {
namespace {

[[noreturn]] void without_opencv() {
  fail(ErrorKind::usage, "--video is not available in this build without OpenCV: write images with --out");
}

}  // namespace

std::vector<std::string> video_extensions() {
  return {"none, because this program was built without OpenCV"};
}

VideoWriter::VideoWriter(std::filesystem::path, int width, int height, double)
    : width_(width), height_(height) {
  without_opencv();
}
VideoWriter::~VideoWriter() = default;
void VideoWriter::write(const Image8&) { without_opencv(); }
void VideoWriter::commit() { without_opencv(); }

DepthRange depth_range(const RenderedView&) { without_opencv(); }
DepthRange united(const DepthRange&, const DepthRange&) { without_opencv(); }
Image8 picture(const RenderedView&, Channel, const DepthRange&) { without_opencv(); }

}  // namespace ubs
