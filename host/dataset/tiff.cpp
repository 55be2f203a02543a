// SPDX-License-Identifier: Apache-2.0
// See tiff.hpp. libtiff decompresses strips and tiles. This file arranges their samples and converts them to
// RGB.
#include "host/dataset/tiff.hpp"

#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/stated_image.hpp"

namespace ubs {
namespace {

// TiffSource contains the data that libtiff's callbacks use.
struct TiffSource {
  std::span<const std::byte> file;
  std::uint64_t position = 0;
  std::string message;  // the first error
};

TiffSource& tiff_source(thandle_t handle) { return *static_cast<TiffSource*>(handle); }

tmsize_t read_tiff(thandle_t handle, void* to, tmsize_t size) {
  TiffSource& source = tiff_source(handle);
  const std::uint64_t left =
      source.position < source.file.size() ? source.file.size() - source.position : std::uint64_t{0};
  const auto count = static_cast<std::size_t>(std::min(left, static_cast<std::uint64_t>(size)));
  if (count > 0) std::memcpy(to, source.file.data() + source.position, count);
  source.position += count;
  return static_cast<tmsize_t>(count);
}
tmsize_t refuse_write(thandle_t, void*, tmsize_t) { return 0; }
toff_t seek_tiff(thandle_t handle, toff_t offset, int whence) {
  TiffSource& source = tiff_source(handle);
  source.position = offset + (whence == SEEK_CUR   ? source.position
                              : whence == SEEK_END ? source.file.size()
                                                   : std::uint64_t{0});
  return source.position;
}
int close_tiff(thandle_t) { return 0; }
toff_t tiff_bytes(thandle_t handle) { return tiff_source(handle).file.size(); }

int keep_error(TIFF*, void* source, const char*, const char* format, va_list arguments) {
  char text[256];
  std::vsnprintf(text, sizeof text, format, arguments);
  if (auto& message = static_cast<TiffSource*>(source)->message; message.empty()) message = text;
  return 1;
}
int ignore_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

// TiffPage describes the pixels of one page as they are stored.
struct TiffPage {
  std::uint32_t width = 0, height = 0;
  std::uint16_t bits = 1, samples = 1, format = SAMPLEFORMAT_UINT, photometric = 0,
                planar = PLANARCONFIG_CONTIG;
  int colours = 1;  // number of samples that are not alpha
  bool alpha = false, premultiplied = false;
};

template <typename Value>
Value tiff_tag(TIFF* tiff, std::uint32_t tag, Value otherwise = {}) {
  Value value = otherwise;
  return TIFFGetFieldDefaulted(tiff, tag, &value) == 1 ? value : otherwise;
}

bool is_copy_or_mask(TIFF* tiff) {
  return (tiff_tag<std::uint32_t>(tiff, TIFFTAG_SUBFILETYPE) & (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) != 0;
}

// Selects the page to decode.
void select_page(TIFF* tiff, const std::string& name) {
  while (is_copy_or_mask(tiff))
    if (TIFFReadDirectory(tiff) != 1) {
      TIFFSetDirectory(tiff, 0);
      return;
    }
  const tdir_t chosen = TIFFCurrentDirectory(tiff);
  bool more = false;
  while (!more && TIFFReadDirectory(tiff) == 1) more = !is_copy_or_mask(tiff);
  if (more) warn_once(fmt::format("{}: only the first page of the TIFF file is used", name));
  TIFFSetDirectory(tiff, chosen);
}

TiffPage page_of(TIFF* tiff, const std::string& name) {
  const auto refuse = [&](const std::string& what) {
    fail(ErrorKind::data, "{}: {} in a TIFF file: convert it to RGB with 8 or 16 bits per sample", name,
         what);
  };
  TiffPage page;
  page.width = tiff_tag<std::uint32_t>(tiff, TIFFTAG_IMAGEWIDTH);
  page.height = tiff_tag<std::uint32_t>(tiff, TIFFTAG_IMAGELENGTH);
  page.bits = tiff_tag<std::uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE, 1);
  page.samples = tiff_tag<std::uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  page.format = tiff_tag<std::uint16_t>(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
  page.planar = tiff_tag<std::uint16_t>(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  if (TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &page.photometric) != 1)
    page.photometric = page.samples < 3 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB;
  if (page.width == 0 || page.height == 0 || page.width > std::numeric_limits<int>::max() ||
      page.height > std::numeric_limits<int>::max())
    fail(ErrorKind::data, "{}: cannot decode: the header is damaged and states no size", name);
  if (page.format != SAMPLEFORMAT_UINT && page.format != SAMPLEFORMAT_VOID)
    fail(ErrorKind::data,
         "{}: only 8- and 16-bit images and EXR are supported: this TIFF file has {} samples, which may or "
         "may not be linear light: convert it to EXR (linear light) or to 16 bits (sRGB)",
         name, page.format == SAMPLEFORMAT_IEEEFP ? "floating-point" : "signed or complex");
  if (page.bits != 1 && page.bits != 2 && page.bits != 4 && page.bits != 8 && page.bits != 16)
    refuse(fmt::format("only 8- and 16-bit images are supported, not {} bits per sample", page.bits));
  switch (page.photometric) {
    case PHOTOMETRIC_MINISWHITE:
    case PHOTOMETRIC_MINISBLACK:
    case PHOTOMETRIC_PALETTE:
      page.colours = 1;
      break;
    case PHOTOMETRIC_RGB:
    case PHOTOMETRIC_YCBCR:
    case PHOTOMETRIC_CIELAB:
      page.colours = 3;
      break;
    case PHOTOMETRIC_SEPARATED:
      page.colours = 4;
      if (tiff_tag<std::uint16_t>(tiff, TIFFTAG_INKSET, INKSET_CMYK) != INKSET_CMYK)
        refuse("inks other than CMYK are not supported");
      break;
    default:
      refuse(fmt::format("photometric interpretation {} is not supported", page.photometric));
  }
  if (page.samples != page.colours && page.samples != page.colours + 1)
    refuse(fmt::format("{} channels are not supported", page.samples));
  if (page.samples == page.colours) return page;
  // A sample whose meaning is missing is alpha, as in Pillow; one that the file calls "unspecified" is not.
  std::uint16_t extras = 0;
  const std::uint16_t* kinds = nullptr;
  const bool stated = TIFFGetField(tiff, TIFFTAG_EXTRASAMPLES, &extras, &kinds) == 1 && extras > 0;
  page.alpha = !stated || kinds[0] != EXTRASAMPLE_UNSPECIFIED;
  page.premultiplied = stated && kinds[0] == EXTRASAMPLE_ASSOCALPHA;
  if (!page.alpha)
    warn_once(
        fmt::format("{}: the fourth channel is not used, because the file does not call it alpha", name));
  if (page.premultiplied && page.photometric != PHOTOMETRIC_RGB && page.photometric != PHOTOMETRIC_MINISBLACK)
    refuse("colours multiplied by alpha are only supported for RGB and grey");
  return page;
}

// Returns a number of 1, 2, 4, 8 or 16 bits. libtiff has converted 16-bit numbers to the byte order of this
// machine.
unsigned sample_at(const std::uint8_t* row, std::size_t index, int bits) {
  if (bits == 8) return row[index];
  if (bits == 16) {
    std::uint16_t value = 0;
    std::memcpy(&value, row + 2 * index, sizeof value);
    return value;
  }
  const std::size_t bit = index * static_cast<std::size_t>(bits);
  return row[bit / 8] >> (8 - bits - static_cast<int>(bit % 8)) & ((1 << bits) - 1);
}

// Reads all strips or tiles. Returns the stored numbers, with as many channels as the page has samples.
template <typename Sample>
cv::Mat stored_samples(TIFF* tiff, const TiffPage& page, TiffSource& source) {
  const int channels = page.samples;
  cv::Mat stored(static_cast<int>(page.height), static_cast<int>(page.width),
                 CV_MAKETYPE(cv::DataType<Sample>::depth, channels));
  const bool tiled = TIFFIsTiled(tiff) != 0, apart = page.planar == PLANARCONFIG_SEPARATE;
  const auto across = tiled ? tiff_tag<std::uint32_t>(tiff, TIFFTAG_TILEWIDTH) : page.width;
  const auto down =
      tiled ? tiff_tag<std::uint32_t>(tiff, TIFFTAG_TILELENGTH)
            : std::min(page.height, tiff_tag<std::uint32_t>(tiff, TIFFTAG_ROWSPERSTRIP, page.height));
  const tmsize_t bytes = tiled ? TIFFTileSize(tiff) : TIFFStripSize(tiff);
  const tmsize_t row_bytes = tiled ? TIFFTileRowSize(tiff) : TIFFScanlineSize(tiff);
  if (across == 0 || down == 0 || bytes <= 0 || row_bytes <= 0) return {};
  std::vector<std::uint8_t> block(static_cast<std::size_t>(bytes));
  for (int plane = 0; plane < (apart ? channels : 1); ++plane)
    for (std::uint32_t y0 = 0; y0 < page.height; y0 += down)
      for (std::uint32_t x0 = 0; x0 < page.width; x0 += across) {
        const auto part = static_cast<std::uint16_t>(plane);
        const std::uint32_t rows = std::min(down, page.height - y0),
                            columns = std::min(across, page.width - x0);
        const tmsize_t found =
            tiled ? TIFFReadEncodedTile(tiff, TIFFComputeTile(tiff, x0, y0, 0, part), block.data(), bytes)
                  : TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, y0, part), block.data(), bytes);
        if (found < (tiled ? bytes : row_bytes * static_cast<tmsize_t>(rows))) {
          if (source.message.empty()) source.message = "the file ends too early";
          return {};
        }
        const std::size_t per_pixel = apart ? 1 : static_cast<std::size_t>(channels);
        if ((columns * per_pixel * page.bits + 7) / 8 > static_cast<std::size_t>(row_bytes)) return {};
        for (std::uint32_t y = 0; y < rows; ++y) {
          const std::uint8_t* in = block.data() + static_cast<std::size_t>(row_bytes) * y;
          Sample* out = stored.ptr<Sample>(static_cast<int>(y0 + y)) + std::size_t{x0} * page.samples + plane;
          for (std::size_t x = 0; x < columns; ++x, out += channels)
            for (std::size_t c = 0; c < per_pixel; ++c)
              out[c] = static_cast<Sample>(sample_at(in, x * per_pixel + c, page.bits));
        }
      }
  return stored;
}

// Converts the stored numbers to grey, BGR or BGRA.
template <typename Sample>
cv::Mat tiff_colours(const cv::Mat& stored, const TiffPage& page,
                     const std::array<std::uint16_t*, 3>& palette) {
  constexpr unsigned kFull = std::numeric_limits<Sample>::max();
  const unsigned top = (1u << page.bits) - 1, entries = 1u << page.bits;
  const bool grey = page.colours == 1 && page.photometric != PHOTOMETRIC_PALETTE;
  const int channels = page.alpha ? 4 : grey ? 1 : 3;
  // The colours of a palette have 16 bits: 8 bits times 256 or 257, depending on the program. Some programs
  // write 8 bits.
  bool small_palette = page.photometric == PHOTOMETRIC_PALETTE;
  for (unsigned i = 0; small_palette && i < entries; ++i)
    for (const std::uint16_t* map : palette) small_palette = small_palette && map[i] < 256;
  const auto scaled = [&](unsigned v) { return static_cast<Sample>(v * kFull / top); };
  const auto colour = [&](const Sample* in, std::size_t c) -> Sample {
    switch (page.photometric) {
      case PHOTOMETRIC_MINISWHITE:
        return scaled(top - in[0]);
      case PHOTOMETRIC_MINISBLACK:
        return scaled(in[0]);
      case PHOTOMETRIC_PALETTE: {
        const unsigned v = palette[c][in[0]];
        return static_cast<Sample>(sizeof(Sample) == 1 ? (small_palette ? v : v >> 8)
                                                       : (small_palette ? 257 * v : v));
      }
      case PHOTOMETRIC_SEPARATED: {
        const std::uint64_t ink = top - in[c], black = top - in[3];
        return scaled(static_cast<unsigned>((2 * ink * black + top) / (2 * std::uint64_t{top})));
      }
      default:
        return scaled(in[c]);
    }
  };
  cv::Mat pixels(stored.rows, stored.cols, CV_MAKETYPE(cv::DataType<Sample>::depth, channels));
  for (int y = 0; y < stored.rows; ++y) {
    const Sample* in = stored.ptr<Sample>(y);
    Sample* out = pixels.ptr<Sample>(y);
    for (int x = 0; x < stored.cols; ++x, in += page.samples, out += channels) {
      if (channels == 1) {
        out[0] = colour(in, 0);
        continue;
      }
      for (std::size_t c = 0; c < 3; ++c) out[c] = colour(in, 2 - c);
      if (page.alpha) out[3] = scaled(in[page.colours]);
    }
  }
  return pixels;
}

// Decodes 8-bit pixels with libtiff's own conversion to RGB.
cv::Mat converted_by_libtiff(TIFF* tiff, const TiffPage& page, TiffSource& source) {
  char reason[1024] = "";
  if (TIFFRGBAImageOK(tiff, reason) != 1) {
    source.message = reason;
    return {};
  }
  std::vector<std::uint32_t> raster(std::size_t{page.width} * page.height);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);  // so that the rows stay as they are stored
  if (TIFFReadRGBAImageOriented(tiff, page.width, page.height, raster.data(), ORIENTATION_TOPLEFT, 1) != 1)
    return {};
  cv::Mat pixels(static_cast<int>(page.height), static_cast<int>(page.width), CV_8UC3);
  std::uint8_t* out = pixels.data;
  for (const std::uint32_t rgba : raster)
    for (const std::uint32_t value : {TIFFGetB(rgba), TIFFGetG(rgba), TIFFGetR(rgba)})
      *out++ = static_cast<std::uint8_t>(value);
  return pixels;
}

}  // namespace

bool is_tiff(std::span<const std::byte> file) {
  if (file.size() < 4) return false;
  for (const char* start : {"II*\0", "MM\0*", "II+\0", "MM\0+"})
    if (std::memcmp(file.data(), start, 4) == 0) return true;
  return false;
}

TiffImage decode_tiff(std::span<const std::byte> file, const std::string& name) {
  TiffSource source{file, 0, {}};
  const auto damaged = [&] {
    fail(ErrorKind::data, "{}: damaged or truncated TIFF: {}", name,
         source.message.empty() ? "its pixels are missing" : source.message);
  };
  const std::unique_ptr<TIFFOpenOptions, void (*)(TIFFOpenOptions*)> options(TIFFOpenOptionsAlloc(),
                                                                             TIFFOpenOptionsFree);
  if (!options) fail(ErrorKind::memory, "{}: not enough memory to decode the image", name);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), keep_error, &source);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), ignore_warning, nullptr);
  const std::unique_ptr<TIFF, void (*)(TIFF*)> tiff(
      TIFFClientOpenExt(name.c_str(), "rm", &source, read_tiff, refuse_write, seek_tiff, close_tiff,
                        tiff_bytes, nullptr, nullptr, options.get()),
      TIFFClose);
  if (!tiff) damaged();
  select_page(tiff.get(), name);
  TiffPage page = page_of(tiff.get(), name);
  const std::uint64_t sample_bytes = page.bits == 16 ? 2 : 1;
  require_image_memory(page.width, page.height, (page.samples + 4u) * sample_bytes, name);
  TiffImage image;
  image.premultiplied = page.premultiplied;
  const auto orientation = tiff_tag<std::uint16_t>(tiff.get(), TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);
  if (orientation >= 1 && orientation <= 8) image.orientation = orientation;
  if (page.photometric == PHOTOMETRIC_YCBCR &&
      tiff_tag<std::uint16_t>(tiff.get(), TIFFTAG_COMPRESSION) == COMPRESSION_JPEG) {
    TIFFSetField(tiff.get(), TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    page.photometric = PHOTOMETRIC_RGB;
  }
  source.message.clear();  // errors in pages that are not used do not matter
  if (page.photometric == PHOTOMETRIC_YCBCR || page.photometric == PHOTOMETRIC_CIELAB) {
    image.pixels = converted_by_libtiff(tiff.get(), page, source);
  } else {
    std::array<std::uint16_t*, 3> palette{};
    if (page.photometric == PHOTOMETRIC_PALETTE &&
        TIFFGetField(tiff.get(), TIFFTAG_COLORMAP, &palette[0], &palette[1], &palette[2]) != 1)
      fail(ErrorKind::data, "{}: damaged or truncated TIFF: the palette is missing", name);
    const cv::Mat stored = page.bits == 16 ? stored_samples<std::uint16_t>(tiff.get(), page, source)
                                           : stored_samples<std::uint8_t>(tiff.get(), page, source);
    if (!stored.empty())
      image.pixels = page.bits == 16 ? tiff_colours<std::uint16_t>(stored, page, palette)
                                     : tiff_colours<std::uint8_t>(stored, page, palette);
  }
  if (image.pixels.empty() || !source.message.empty()) damaged();
  return image;
}

}  // namespace ubs
