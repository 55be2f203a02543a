// SPDX-License-Identifier: Apache-2.0
// This file replaces the functions that use OpenCV in a build without OpenCV (UBS_OPENCV=OFF). Such a build
// can read packed data sets. align_cameras() and triangulate() return an empty result; the other functions
// throw an error which says that the program was built without OpenCV.
#include <span>
#include <vector>

#include "host/base/error.hpp"
#include "host/dataset/align_cameras.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/triangulate.hpp"
#include "host/dataset/undistort.hpp"
#include "host/dataset/video.hpp"
#include "host/formats/covariance_axes.hpp"
#include "host/formats/webp.hpp"

namespace ubs {
namespace {

[[noreturn]] void without_opencv(const std::string& what) {
  fail(ErrorKind::usage,
       "{}: this program was built without OpenCV and reads only packed data sets: create one with 'ubs "
       "pack' of a complete build",
       what);
}

}  // namespace

Image8 load_image(const std::filesystem::path& path, const std::array<double, 3>&) {
  without_opencv(path.string());
}
Image8 load_mask_image(const std::filesystem::path& path, const Image8&) { without_opencv(path.string()); }
ImageInfo decoded_info(const std::filesystem::path& path) { without_opencv(path.string()); }
std::vector<std::byte> encode_webp(const Rgba8&) { without_opencv("SOG files"); }
Rgba8 decode_webp(std::span<const std::byte>, std::size_t, const std::string& name) { without_opencv(name); }
Image8 undistort(const Image8&, const Undistortion&) { without_opencv("undistorting images"); }
CovarianceAxes covariance_axes(const Matrix3&) { without_opencv("computing the axes of covariances"); }
CovarianceAxes covariance_axes(const double (&)[3][3]) {
  without_opencv("computing the axes of covariances");
}
Alignment align_cameras(std::span<const View>) { return {}; }
Triangulation triangulate(std::span<const View>, std::size_t, std::size_t, std::uint64_t) { return {}; }

class VideoFile {};
std::shared_ptr<VideoFile> open_video(const std::filesystem::path& path) { without_opencv(path.string()); }
ImageSize video_size(const VideoFile&) { without_opencv("videos"); }
int video_frames(const VideoFile&) { without_opencv("videos"); }
std::shared_ptr<const ImageSource> video_frame_source(std::shared_ptr<VideoFile>, int, int, int) {
  without_opencv("videos");
}

}  // namespace ubs
