// SPDX-License-Identifier: Apache-2.0
// A build without OpenCV (UBS_OPENCV=OFF): packed data sets are read, PNG files are written with zlib, and
// what would decode images or videos says what it needs.
#include <zlib.h>

#include <cstdint>
#include <span>
#include <vector>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/data/align_cameras.hpp"
#include "host/data/covariance_axes.hpp"
#include "host/data/image.hpp"
#include "host/data/image_info.hpp"
#include "host/data/lens.hpp"
#include "host/data/png.hpp"
#include "host/data/triangulate.hpp"
#include "host/data/video.hpp"
#include "host/data/webp.hpp"

namespace ubs {
namespace {

[[noreturn]] void without_opencv(const std::string& what) {
  fail(ErrorKind::usage,
       "{}: this program was built without OpenCV and reads packed data sets only; make one with "
       "'ubs pack' of a complete build",
       what);
}

using PngBytes = std::vector<std::byte>;

void put32(PngBytes& to, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) to.push_back(static_cast<std::byte>(value >> shift));
}

void put_chunk(PngBytes& to, const char (&name)[5], const PngBytes& content) {
  put32(to, static_cast<std::uint32_t>(content.size()));
  const std::size_t checked = to.size();
  for (int i = 0; i < 4; ++i) to.push_back(static_cast<std::byte>(name[i]));
  to.insert(to.end(), content.begin(), content.end());
  put32(to, crc32(std::span(to).subspan(checked)));
}

// Rows behind the byte that says that they are not filtered; samples big-endian.
PngBytes png_rows(const PngForm& form, const void* samples) {
  const std::size_t row = static_cast<std::size_t>(form.width) * static_cast<std::size_t>(form.channels);
  const auto* bytes = static_cast<const std::byte*>(samples);
  PngBytes rows;
  for (int y = 0; y < form.height; ++y) {
    rows.push_back(std::byte{0});
    for (std::size_t i = 0; i < row; ++i) {
      const std::size_t at = (static_cast<std::size_t>(y) * row + i) * static_cast<std::size_t>(form.bytes);
      if (form.bytes == 2) rows.push_back(bytes[at + 1]);
      rows.push_back(bytes[at]);
    }
  }
  return rows;
}

PngBytes deflated(const PngBytes& content) {
  uLongf size = compressBound(static_cast<uLong>(content.size()));
  PngBytes out(size);
  if (compress(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(content.data()),
               static_cast<uLong>(content.size())) != Z_OK)
    fail(ErrorKind::internal, "zlib does not compress {} bytes", content.size());
  out.resize(size);
  return out;
}

}  // namespace

void write_png(const std::filesystem::path& path, const PngForm& form, const void* samples, FileUse use) {
  constexpr int kColourTypes[] = {0, 0, 0, 2, 6};  // by channels: grey, RGB, RGBA
  PngBytes header;
  put32(header, static_cast<std::uint32_t>(form.width));
  put32(header, static_cast<std::uint32_t>(form.height));
  for (const int value : {8 * form.bytes, kColourTypes[form.channels], 0, 0, 0})
    header.push_back(static_cast<std::byte>(value));
  constexpr unsigned char kSignature[] = {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a};
  PngBytes file;
  for (const unsigned char value : kSignature) file.push_back(std::byte{value});
  put_chunk(file, "IHDR", header);
  put_chunk(file, "IDAT", deflated(png_rows(form, samples)));
  put_chunk(file, "IEND", {});
  write_file_atomically(path, file, use);
}

Image8 load_image(const std::filesystem::path& path, const std::array<double, 3>&) {
  without_opencv(path.string());
}
Image8 load_mask_image(const std::filesystem::path& path, const Image8&) { without_opencv(path.string()); }
ImageSize decoded_size(const std::filesystem::path& path) { without_opencv(path.string()); }
std::vector<std::byte> encode_webp(const Rgba8&) { without_opencv("SOG files"); }
Rgba8 decode_webp(std::span<const std::byte>, std::size_t, const std::string& name) { without_opencv(name); }
Image8 undistort(const Image8&, const Undistortion&) { without_opencv("undistorting images"); }
CovarianceAxes covariance_axes(const Matrix3&) { without_opencv("axes of covariances of foreign splats"); }
CovarianceAxes covariance_axes(const double (&)[3][3]) {
  without_opencv("axes of covariances of foreign splats");
}
Alignment align_cameras(std::span<const View>) { return {}; }
Triangulation triangulate(std::span<const View>, std::size_t, std::uint64_t) { return {}; }

class VideoFile {};
std::shared_ptr<VideoFile> open_video(const std::filesystem::path& path) { without_opencv(path.string()); }
ImageSize video_size(const VideoFile&) { without_opencv("videos"); }
int video_frames(const VideoFile&) { without_opencv("videos"); }
std::shared_ptr<const ImageSource> video_frame_source(std::shared_ptr<VideoFile>, int, int, int) {
  without_opencv("videos");
}

}  // namespace ubs
