// SPDX-License-Identifier: Apache-2.0
// See exr.hpp.
#include "host/dataset/exr.hpp"

#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfChromaticities.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <string_view>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/stated_image.hpp"

namespace ubs {
namespace {

// ExrBytes is a stream of the OpenEXR library that reads from memory.
class ExrBytes : public Imf::IStream {
 public:
  explicit ExrBytes(std::span<const std::byte> file) : Imf::IStream("image"), file_(file) {}
  bool read(char to[], int count) override {
    const auto size = static_cast<std::uint64_t>(std::max(count, 0));
    if (position_ > file_.size() || size > file_.size() - position_)
      throw std::runtime_error("the file ends too early");
    std::memcpy(to, file_.data() + position_, size);
    position_ += size;
    return position_ < file_.size();
  }
  std::uint64_t tellg() override { return position_; }
  void seekg(std::uint64_t position) override { position_ = position; }

 private:
  std::span<const std::byte> file_;
  std::uint64_t position_ = 0;
};

// ExrPicture describes channels that form an image.
struct ExrPicture {
  int part = 0;
  std::string layer;  // for messages and to choose: names of part and layer
  std::array<std::string, 3>
      colours;        // names of the channels of red, green and blue; of a grey image only red
  std::string alpha;  // empty if there is none
  bool grey = false, chroma = false;  // chroma: luminance, and colour differences at half the resolution
};

bool ends_with_name(std::string_view layer, std::string_view name) {
  const std::size_t dot = layer.size() > name.size() ? layer.size() - name.size() - 1 : 0;
  if (layer.size() < name.size() || (layer.size() > name.size() && layer[dot] != '.')) return false;
  return std::ranges::equal(
      layer.substr(layer.size() - name.size()), name,
      [](unsigned char a, unsigned char b) { return std::tolower(a) == std::tolower(b); });
}

// Returns the pictures of all parts in the order of the file.
std::vector<ExrPicture> pictures_in(const Imf::MultiPartInputFile& file) {
  std::vector<ExrPicture> pictures;
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    if (header.hasType() && Imf::isDeepData(header.type())) continue;
    const Imf::ChannelList& channels = header.channels();
    const auto has = [&](const std::string& name) { return channels.findChannel(name) != nullptr; };
    std::vector<std::string> prefixes;
    for (auto c = channels.begin(); c != channels.end(); ++c) {
      const std::string name = c.name();
      const std::size_t dot = name.rfind('.');
      const std::string prefix = dot == std::string::npos ? "" : name.substr(0, dot + 1);
      if (std::ranges::find(prefixes, prefix) == prefixes.end()) prefixes.push_back(prefix);
    }
    for (const std::string& prefix : prefixes) {
      ExrPicture picture;
      picture.part = part;
      if (file.parts() > 1 && header.hasName()) picture.layer = header.name();
      if (!prefix.empty()) {
        if (!picture.layer.empty()) picture.layer += '.';
        picture.layer += prefix.substr(0, prefix.size() - 1);
      }
      const auto use = [&](const char* r, const char* g, const char* b, const char* a) {
        if (!has(prefix + r) || !has(prefix + g) || !has(prefix + b)) return false;
        picture.colours = {prefix + r, prefix + g, prefix + b};
        if (has(prefix + a)) picture.alpha = prefix + a;
        return true;
      };
      bool found = use("R", "G", "B", "A") || use("r", "g", "b", "a") || use("red", "green", "blue", "alpha");
      if (!found && has(prefix + "Y")) {
        found = picture.grey = true;
        picture.colours[0] = prefix + "Y";
        if (has(prefix + "A")) picture.alpha = prefix + "A";
        picture.chroma = has(prefix + "RY") && has(prefix + "BY");
      }
      if (found) pictures.push_back(std::move(picture));
    }
  }
  return pictures;
}

const ExrPicture& chosen_picture(const std::vector<ExrPicture>& pictures, const std::string& name) {
  if (pictures.empty())
    fail(ErrorKind::data, "{}: the EXR file has no layer with the channels R, G and B, or Y", name);
  if (pictures.size() == 1) return pictures.front();
  // A picture without the name of a layer comes first. "Composite" is the result of Blender's compositor.
  for (const std::string_view wanted :
       {"", "composite.combined", "combined", "combined.left", "rgba", "rgb", "beauty", "color", "c"})
    for (const ExrPicture& picture : pictures)
      if (wanted.empty() ? picture.layer.empty() : ends_with_name(picture.layer, wanted)) return picture;
  std::vector<std::string> names;
  for (const ExrPicture& picture : pictures) names.push_back(picture.layer);
  fail(ErrorKind::data,
       "{}: cannot tell which layer of the EXR file is the picture: {}: save a file with the channels R, G, "
       "B and A "
       "of this layer only",
       name, fmt::join(names, ", "));
}

struct ExrWindow {
  int x = 0, y = 0, width = 0, height = 0;
};

ExrWindow exr_window(const Imath::Box2i& box, const std::string& name) {
  const std::int64_t width = std::int64_t{box.max.x} - box.min.x + 1,
                     height = std::int64_t{box.max.y} - box.min.y + 1;
  constexpr int kMost = std::numeric_limits<int>::max();
  if (width < 1 || height < 1 || width > kMost || height > kMost)
    fail(ErrorKind::data, "{}: cannot decode: the header is damaged and states no size", name);
  return {box.min.x, box.min.y, static_cast<int>(width), static_cast<int>(height)};
}

// Returns the pixels of the data window with the channels of `picture`.
cv::Mat data_window(Imf::MultiPartInputFile& file, const ExrPicture& picture, const ExrWindow& data) {
  const bool alpha = !picture.alpha.empty();
  cv::Mat pixels(data.height, data.width, CV_32FC(alpha ? 4 : picture.grey ? 1 : 3), cv::Scalar::all(0));
  const int channels = pixels.channels();
  Imf::FrameBuffer buffer;
  const auto put = [&](const std::string& channel, int to) {
    buffer.insert(
        channel,
        Imf::Slice::Make(Imf::FLOAT, pixels.ptr<float>() + to, Imath::V2i(data.x, data.y), data.width,
                         data.height, sizeof(float) * static_cast<std::size_t>(channels), pixels.step[0]));
  };
  if (picture.grey)
    put(picture.colours[0], 0);
  else
    for (int c = 0; c < 3; ++c) put(picture.colours[static_cast<std::size_t>(2 - c)], c);
  if (alpha) put(picture.alpha, 3);
  Imf::InputPart part(file, picture.part);
  part.setFrameBuffer(buffer);
  part.readPixels(data.y, data.y + data.height - 1);
  if (picture.grey && alpha)
    for (int y = 0; y < pixels.rows; ++y)
      for (int x = 0; x < pixels.cols; ++x) {
        float* p = pixels.ptr<float>(y) + 4 * x;
        p[1] = p[2] = p[0];
      }
  return pixels;
}

// Returns the pixels of the data window of a file with luminance and subsampled colour differences.
cv::Mat converted_chroma(ExrBytes& stream, const std::string& layer, const ExrWindow& data, bool alpha) {
  stream.seekg(0);
  Imf::RgbaInputFile file(stream, layer);
  std::vector<Imf::Rgba> rows(static_cast<std::size_t>(data.width) * static_cast<std::size_t>(data.height));
  file.setFrameBuffer(rows.data() - data.x - std::ptrdiff_t{data.y} * data.width, 1,
                      static_cast<std::size_t>(data.width));
  file.readPixels(data.y, data.y + data.height - 1);
  cv::Mat pixels(data.height, data.width, CV_32FC(alpha ? 4 : 3));
  auto* out = pixels.ptr<float>();
  for (const Imf::Rgba& p : rows) {
    *out++ = p.b, *out++ = p.g, *out++ = p.r;
    if (alpha) *out++ = p.a;
  }
  return pixels;
}

bool has_srgb_primaries(const Imf::Header& header) {
  if (!Imf::hasChromaticities(header)) return true;
  const Imf::Chromaticities &found = Imf::chromaticities(header), srgb;
  const auto near = [](const Imath::V2f& a, const Imath::V2f& b) {
    return std::abs(a.x - b.x) < 2e-3f && std::abs(a.y - b.y) < 2e-3f;
  };
  return near(found.red, srgb.red) && near(found.green, srgb.green) && near(found.blue, srgb.blue) &&
         near(found.white, srgb.white);
}

cv::Mat decode(ExrBytes& stream, const std::string& name) {
  Imf::MultiPartInputFile file(stream);
  const std::vector<ExrPicture> pictures = pictures_in(file);
  const ExrPicture& picture = chosen_picture(pictures, name);
  const Imf::Header& header = file.header(picture.part);
  if (!has_srgb_primaries(header))
    warn_once(fmt::format("{}: the colours have other primaries than sRGB, and are not converted", name));
  const ExrWindow display = exr_window(header.displayWindow(), name),
                  data = exr_window(header.dataWindow(), name);
  for (const ExrWindow& window : {display, data})
    require_image_memory(static_cast<std::uint64_t>(window.width), static_cast<std::uint64_t>(window.height),
                         32, name);
  if (picture.chroma && file.parts() > 1)
    fail(ErrorKind::data, "{}: luminance and chroma in an EXR file with several parts are not supported",
         name);
  const std::size_t dot = picture.colours[0].rfind('.');
  const cv::Mat pixels =
      picture.chroma
          ? converted_chroma(stream, dot == std::string::npos ? "" : picture.colours[0].substr(0, dot), data,
                             !picture.alpha.empty())
          : data_window(file, picture, data);
  if (data.x == display.x && data.y == display.y && pixels.cols == display.width &&
      pixels.rows == display.height)
    return pixels;
  cv::Mat shown(display.height, display.width, pixels.type(), cv::Scalar::all(0));
  const cv::Rect common = cv::Rect(data.x, data.y, data.width, data.height) &
                          cv::Rect(display.x, display.y, display.width, display.height);
  if (!common.empty())
    pixels(common - cv::Point(data.x, data.y)).copyTo(shown(common - cv::Point(display.x, display.y)));
  return shown;
}

}  // namespace

bool is_exr(std::span<const std::byte> file) {
  constexpr unsigned char kMagic[] = {0x76, 0x2f, 0x31, 0x01};
  return file.size() >= sizeof kMagic && std::memcmp(file.data(), kMagic, sizeof kMagic) == 0;
}

cv::Mat decode_exr(std::span<const std::byte> file, const std::string& name) {
  ExrBytes stream(file);
  try {
    return decode(stream, name);
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    fail(ErrorKind::memory, "{}: not enough memory to decode the image", name);
  } catch (const std::exception& error) {
    fail(ErrorKind::data, "{}: damaged or truncated EXR: {}", name, error.what());
  }
}

}  // namespace ubs
