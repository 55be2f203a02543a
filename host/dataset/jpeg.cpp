// SPDX-License-Identifier: Apache-2.0
// See jpeg.hpp.
#include "host/dataset/jpeg.hpp"

#include <turbojpeg.h>

#include <memory>

#include "host/base/error.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/stated_image.hpp"

namespace ubs {
namespace {

// Maximum number of pixels per byte of a file. It is checked because TurboJPEG allocates memory for all
// pixels before it decodes them. No undamaged file with Huffman coding has more than 456 pixels per byte:
// with the strongest chroma subsampling, 1024 pixels are stored in 18 blocks of samples, and each block takes
// at least one bit.
constexpr std::size_t kMaxJpegPixelsPerByte = 1000;

}  // namespace

bool is_jpeg(std::span<const std::byte> file) {
  return file.size() > 2 && file[0] == std::byte{0xff} && file[1] == std::byte{0xd8} &&
         file[2] == std::byte{0xff};
}

cv::Mat decode_jpeg(std::span<const std::byte> file, const std::string& name) {
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  if (decoder == nullptr) fail(ErrorKind::memory, "{}: not enough memory to decode the image", name);
  const auto damaged = [&](const std::string& what) {
    fail(ErrorKind::data,
         "{}: damaged or truncated JPEG: {}: copy it again, or save it again if other programs show it "
         "correctly",
         name, what);
  };
  const auto* bytes = reinterpret_cast<const unsigned char*>(file.data());
  int width = 0, height = 0, subsampling = 0, colours = 0;
  const int read =
      tjDecompressHeader3(decoder.get(), bytes, file.size(), &width, &height, &subsampling, &colours);
  // If a size was read, the result -1 is not an error. The cause is then a warning, which tjDecompress2
  // repeats, or a kind of subsampling that TurboJPEG can decode, but has no name for.
  if (width < 1) damaged(read == 0 ? "it contains no image" : tjGetErrorStr2(decoder.get()));
  const std::size_t count = std::size_t(width) * std::size_t(height);
  if (count / kMaxJpegPixelsPerByte > file.size())
    damaged(fmt::format("{} x {} pixels cannot be stored in {} bytes", width, height, file.size()));
  const bool grey = colours == TJCS_GRAY, cmyk = colours == TJCS_CMYK || colours == TJCS_YCCK;
  require_image_memory(static_cast<std::uint64_t>(width), static_cast<std::uint64_t>(height), grey ? 1 : 4,
                       name);
  cv::Mat pixels(height, width, CV_8UC(grey ? 1 : cmyk ? 4 : 3));
  if (tjDecompress2(decoder.get(), bytes, file.size(), pixels.data, width, 0, height,
                    grey   ? TJPF_GRAY
                    : cmyk ? TJPF_CMYK
                           : TJPF_BGR,
                    TJFLAG_STOPONWARNING) != 0)
    damaged(tjGetErrorStr2(decoder.get()));
  return cmyk ? cv::Mat() : pixels;
}

}  // namespace ubs
