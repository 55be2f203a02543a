// SPDX-License-Identifier: Apache-2.0
// Reads and writes Niantic SPZ; see foreign_formats.hpp. The header is followed by one array per attribute:
// - positions (24-bit fixed point)
// - opacities, colours and log scales (8 bits per number)
// - rotations. Version 2 stores x, y and z with 8 bits each; versions 3 and 4 store the three smallest
//   components with 10 bits each.
// - spherical harmonics of degree 1 and higher (8 bits per number; the channel is the fastest index)
// Versions 2 and 3 compress the whole file with gzip. In version 4, each attribute is a Zstandard stream, and
// a table contains the sizes of the streams. Records of extensions (a type, a size and data) follow the
// attributes in versions 2 and 3, and the header in version 4.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>

#include "host/base/byte_reader.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::uint32_t kSpzMagic = 0x5053474e;  // "NGSP"
constexpr std::size_t kHeader = 16;
constexpr std::size_t kHeaderV4 = 32;
constexpr std::uint8_t kAntialiased = 1, kExtended = 2;  // flags
// Types of extensions, and the largest size of all extensions of a file.
constexpr std::uint32_t kOrbitCamera = 0xadbe0002, kCoordinateSystem = 0xadbe0003;
constexpr std::size_t kMaxExtensions = 1 << 20;
constexpr double kColourScale = 0.15;  // scale of the coefficient of degree 0 of the spherical harmonics
constexpr int kFractionBits = 12;      // fraction bits that the writer uses if the scene is not too large
// Maximum absolute value of a coordinate in quantisation steps. The largest signed number with 24 bits is one
// larger.
constexpr double kMostSteps = 8388606;
// Maximum plausible compression ratio. Zstandard can compress constant data so strongly that a small damaged
// file could state any number of splats, but the data of real splats are not constant.
constexpr std::size_t kMaxZstdRatio = 20000;

struct Header {
  std::uint32_t version = 0, count = 0;
  std::uint8_t degree = 0, fraction_bits = 0, flags = 0, streams = 0;
};

Header read_header(ByteReader& in) {
  if (in.remaining() < kHeader || in.read<std::uint32_t>() != kSpzMagic)
    fail(ErrorKind::data, "{}: not an SPZ file", in.name());
  Header h;
  h.version = in.read<std::uint32_t>();
  h.count = in.read<std::uint32_t>();
  h.degree = in.read<std::uint8_t>();
  h.fraction_bits = in.read<std::uint8_t>();
  h.flags = in.read<std::uint8_t>();
  h.streams = in.read<std::uint8_t>();  // reserved in versions before 4
  if (h.version < 2 || h.version > 4)
    fail(ErrorKind::data, "{}: SPZ version {} is not supported, only 2, 3 and 4", in.name(), h.version);
  if (h.degree > 4)
    fail(ErrorKind::data, "{}: spherical harmonics of degree {} are not supported", in.name(), h.degree);
  if (h.fraction_bits > 23)
    fail(ErrorKind::data, "{}: {} fraction bits are not possible: a coordinate has 23 bits and a sign",
         in.name(), h.fraction_bits);
  return h;
}

// Returns the bytes per splat of each attribute, in file order.
std::array<std::size_t, 6> attribute_sizes(const Header& h) {
  const std::size_t harmonics = 3 * (static_cast<std::size_t>((h.degree + 1) * (h.degree + 1)) - 1);
  return {9, 1, 3, 3, h.version == 2 ? 3u : 4u, harmonics};
}

using Signs = std::array<float, 3>;

struct Extensions {
  Signs signs{1, -1, -1};  // factors that convert x, y and z of the file to the axes of PLY files
  LoadReport report;
};

// Returns the factors that convert a coordinate system of the extension to the axes of PLY files, x right, y
// down and z forward. The systems 1 to 8 (LDB, RDB, LUB, RUB, LDF, RDF, LUF, RUF) only differ in the signs of
// the axes; 0 is the usual system of SPZ files, which is RUB. In the systems 9 to 16, y and z are exchanged.
Signs signs_of(std::uint32_t system, const std::string& name) {
  if (system == 0) return Extensions().signs;
  if (system > 8)
    fail(ErrorKind::data,
         "{}: coordinate system {} of the extension SPZ_ADOBE_coordinate_system is not supported, only "
         "0 to 8: export the splats with y up or y down, or as PLY",
         name, system);
  const std::uint32_t bits = system - 1;
  return {bits & 1 ? 1.0f : -1.0f, bits & 2 ? -1.0f : 1.0f, bits & 4 ? 1.0f : -1.0f};
}

// Reads the records of the extensions from the remaining bytes.
Extensions read_extensions(ByteReader& in) {
  Extensions found;
  std::size_t unknown = 0;
  std::uint32_t example = 0;
  while (in.remaining() > 0) {
    const auto type = in.read<std::uint32_t>(), size = in.read<std::uint32_t>();
    ByteReader data(in.take(size), in.name());
    if (type == kCoordinateSystem)
      found.signs = signs_of(data.read<std::uint32_t>(), in.name());
    else if (type == kOrbitCamera)
      found.report.note(
          "the extension SPZ_ADOBE_safe_orbit_camera is not used: it limits where viewers move");
    else if (++unknown == 1)
      example = type;
  }
  if (unknown > 0)
    found.report.note(fmt::format(
        "{} extensions are ignored, because their meaning is unknown (such as {:#x})", unknown, example));
  return found;
}

// Returns the sign of each coefficient of degree 1 to 3 of the spherical harmonics if x, y and z are
// multiplied by `signs`. It is the product of the signs of the coordinates in the polynomial.
std::array<float, 15> harmonic_signs(const Signs& signs) {
  const auto [x, y, z] = signs;
  return {y, z, x, x * y, y * z, 1, x * z, 1, y, x * y * z, y, z, x, z, x};
}

std::uint8_t byte_at(Bytes bytes, std::size_t i) { return std::to_integer<std::uint8_t>(bytes[i]); }

float position_at(Bytes bytes, std::size_t i, double step) {
  const std::uint32_t raw =
      byte_at(bytes, 3 * i) | byte_at(bytes, 3 * i + 1) << 8 | byte_at(bytes, 3 * i + 2) << 16;
  const std::int32_t value = static_cast<std::int32_t>(raw << 8) >> 8;  // extends the sign of 24 bits
  return static_cast<float>(value * step);
}

std::array<float, 4> rotation_v2(Bytes bytes, std::size_t i) {
  std::array<float, 4> q{};
  float sum = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    q[k + 1] = static_cast<float>(byte_at(bytes, 3 * i + k)) / 127.5f - 1;
    sum += q[k + 1] * q[k + 1];
  }
  q[0] = std::sqrt(std::max(0.0f, 1 - sum));
  return q;
}

// Decodes a quaternion, whose components have the order x y z w. The two highest bits are the index of the
// largest component. The other components are stored with a sign and 9 bits of magnitude each, the last one
// in the lowest bits.
std::array<float, 4> rotation_v3(Bytes bytes, std::size_t i) {
  std::uint32_t packed;
  std::memcpy(&packed, bytes.data() + 4 * i, sizeof packed);
  const std::size_t largest = packed >> 30;
  std::array<float, 4> xyzw{};
  float sum = 0;
  for (std::size_t k = 4; k-- > 0;) {
    if (k == largest) continue;
    const float magnitude = std::sqrt(0.5f) * static_cast<float>(packed & 511) / 511.0f;
    xyzw[k] = packed >> 9 & 1 ? -magnitude : magnitude;
    sum += magnitude * magnitude;
    packed >>= 10;
  }
  xyzw[largest] = std::sqrt(std::max(0.0f, 1 - sum));
  return {xyzw[3], xyzw[0], xyzw[1], xyzw[2]};
}

ImportedSplats unpack(const Header& h, const std::array<Bytes, 6>& a, const Extensions& extensions,
                      const std::string& name) {
  ImportedSplats splats;
  splats.report = extensions.report;
  splats.sh_degree = std::min<int>(h.degree, 3);
  splats.antialiased = h.flags & kAntialiased;
  splats.resize(h.count);
  const double step = std::ldexp(1.0, -h.fraction_bits);
  const std::size_t stored = attribute_sizes(h)[5], coefficients = splats.coefficients();
  const auto [x, y, z] = extensions.signs;
  const std::array<float, 15> signs = harmonic_signs(extensions.signs);
  for (std::size_t i = 0; i < h.count; ++i) {  // harmonics of degree 4 are dropped
    splats.positions[i] = {x * position_at(a[0], 3 * i, step), y * position_at(a[0], 3 * i + 1, step),
                           z * position_at(a[0], 3 * i + 2, step)};
    splats.opacity_logits[i] = logit_of(byte_at(a[1], i) / 255.0);
    float* sh = &splats.sh[i * 3 * coefficients];
    for (std::size_t c = 0; c < 3; ++c) {
      sh[c] = static_cast<float>((byte_at(a[2], 3 * i + c) / 255.0 - 0.5) / kColourScale);
      splats.log_scales[i][c] = static_cast<float>(byte_at(a[3], 3 * i + c)) / 16.0f - 10.0f;
    }
    const std::array<float, 4> q = h.version == 2 ? rotation_v2(a[4], i) : rotation_v3(a[4], i);
    splats.rotations[i] = {q[0], y * z * q[1], x * z * q[2], x * y * q[3]};
    for (std::size_t k = 0; k + 3 < 3 * coefficients; ++k)
      sh[k + 3] = signs[k / 3] * (static_cast<float>(byte_at(a[5], i * stored + k)) - 128.0f) / 128.0f;
  }
  splats.report.layout = fmt::format("SPZ version {}", h.version);
  splats.report.folder = name;
  if (h.degree > 3) splats.report.note("spherical harmonics of degree 4 are dropped");
  if (splats.antialiased) splats.report.note("the splats were trained with antialiasing");
  if (const int others = h.flags & ~(kAntialiased | kExtended); others != 0)
    splats.report.note(fmt::format("flags {:#x} are ignored, because their meaning is unknown", others));
  clean(splats);
  return splats;
}

ImportedSplats parse_v4(Bytes file, const std::string& name) {
  ByteReader in(file, name);
  const Header h = read_header(in);
  const std::size_t table = in.read<std::uint32_t>();
  const auto sizes = attribute_sizes(h);
  const std::size_t wanted = h.degree > 0 ? 6 : 5;
  if (h.streams < wanted)
    fail(ErrorKind::data, "{}: the file has {} streams, but the attributes need {}", name, h.streams, wanted);
  if (table < kHeaderV4 || table > file.size() || (file.size() - table) / 16 < h.streams)
    fail(ErrorKind::data,
         "{}: the table of {} streams cannot be at byte {}: it must be after the header and inside the file",
         name, h.streams, table);
  ByteReader between(file.first(table), name);
  between.skip(kHeaderV4);
  Extensions extensions;
  if (h.flags & kExtended)
    extensions = read_extensions(between);
  else if (between.remaining() > 0)
    extensions.report.note(fmt::format("{} bytes after the header are not used", between.remaining()));
  ByteReader toc(file.subspan(table), name);
  std::size_t at = table + 16 * std::size_t{h.streams};
  std::array<std::vector<std::byte>, 6> plain;
  std::array<Bytes, 6> attributes;
  for (std::size_t s = 0; s < wanted; ++s) {
    const auto packed = toc.read<std::uint64_t>(), size = toc.read<std::uint64_t>();
    if (size != sizes[s] * h.count)
      fail(ErrorKind::data, "{}: stream {} has {} bytes, but {} splats need {}", name, s, size, h.count,
           sizes[s] * h.count);
    if (packed > file.size() - at || size / kMaxZstdRatio > packed)
      fail(ErrorKind::data, "{}: the file is truncated in stream {}", name, s);
    plain[s] = inflate_zstd(file.subspan(at, packed), size, name);
    attributes[s] = plain[s];
    at += packed;
  }
  // Later versions of the format may add streams. Only their sizes are known.
  for (std::size_t s = wanted; s < h.streams; ++s) {
    const auto packed = toc.read<std::uint64_t>();
    toc.skip(sizeof(std::uint64_t));
    if (packed > file.size() - at) fail(ErrorKind::data, "{}: the file is truncated in stream {}", name, s);
    at += packed;
  }
  if (at != file.size()) fail(ErrorKind::data, "{}: {} bytes follow the last stream", name, file.size() - at);
  ImportedSplats splats = unpack(h, attributes, extensions, name);
  if (h.streams > wanted)
    splats.report.note(
        fmt::format("{} streams after those of the attributes are not used", h.streams - wanted));
  return splats;
}

std::uint32_t pack_rotation(const std::array<float, 4>& wxyz) {
  const std::array<float, 4> q{wxyz[1], wxyz[2], wxyz[3], wxyz[0]};
  std::size_t largest = 0;
  for (std::size_t k = 1; k < 4; ++k)
    if (std::abs(q[k]) > std::abs(q[largest])) largest = k;
  const bool negate = q[largest] < 0;
  std::uint32_t packed = static_cast<std::uint32_t>(largest);
  for (std::size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    const float magnitude = std::min(511.0f, std::round(std::abs(q[k]) * std::sqrt(2.0f) * 511.0f));
    packed = packed << 10 | static_cast<std::uint32_t>((q[k] < 0) != negate) << 9 |
             static_cast<std::uint32_t>(magnitude);
  }
  return packed;
}

std::byte quantise(double v) { return static_cast<std::byte>(std::clamp(std::lround(v), 0l, 255l)); }

double largest_coordinate(const ImportedSplats& splats) {
  double largest = 0;
  for (const auto& p : splats.positions)
    for (const float v : p) largest = std::max(largest, std::abs(static_cast<double>(v)));
  return largest;
}

// Returns the number of fraction bits: kFractionBits, or the largest smaller number with which the largest
// coordinate can be stored. If it cannot be stored with any number of fraction bits, also returns 0.
int fraction_bits_for(double largest) {
  int bits = kFractionBits;
  while (bits > 0 && std::ldexp(largest, bits) > kMostSteps) --bits;
  return bits;
}

}  // namespace

ImportedSplats parse_spz(Bytes payload, const std::string& name) {
  ByteReader in(payload, name);
  const Header h = read_header(in);
  if (h.version == 4) fail(ErrorKind::data, "{}: version 4 is not allowed inside gzip", name);
  std::array<Bytes, 6> attributes;
  const auto sizes = attribute_sizes(h);
  for (std::size_t s = 0; s < 6; ++s) attributes[s] = in.take(sizes[s] * h.count);
  const Extensions extensions = h.flags & kExtended ? read_extensions(in) : Extensions();
  if (in.remaining() > 0) fail(ErrorKind::data, "{}: {} bytes follow the last splat", name, in.remaining());
  return unpack(h, attributes, extensions, name);
}

ImportedSplats read_spz(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::vector<std::byte> bytes = read_file(path);
  if (bytes.size() < 18) fail(ErrorKind::data, "{}: the file is too short for an SPZ file", name);
  std::uint32_t magic;
  std::memcpy(&magic, bytes.data(), sizeof magic);
  // The file is not compressed with gzip. It has version 4, or has an older version and was unpacked.
  if (magic == kSpzMagic) {
    ByteReader plain(bytes, name);
    return read_header(plain).version == 4 ? parse_v4(bytes, name) : parse_spz(bytes, name);
  }
  const std::vector<std::byte> start = inflate_gzip_start(bytes, kHeader, name);
  ByteReader in(start, name);
  const Header h = read_header(in);
  const auto sizes = attribute_sizes(h);
  const std::size_t splat = std::accumulate(sizes.begin(), sizes.end(), std::size_t{0});
  const std::size_t more = h.flags & kExtended ? kMaxExtensions : 1;
  return parse_spz(inflate_gzip(bytes, kHeader + splat * h.count + more, name), name);
}

void write_spz(const std::filesystem::path& path, const ImportedSplats& splats) {
  require_splats(path, splats);
  const double largest = largest_coordinate(splats);
  const int bits = fraction_bits_for(largest), degree = std::min(splats.sh_degree, 3);
  if (std::ldexp(largest, bits) > kMostSteps)
    fail(ErrorKind::data, "{}: coordinate {} is too large for the 24 bits of SPZ", path.string(), largest);
  const std::size_t n = splats.count(), coefficients = splats.coefficients();
  const std::size_t higher = static_cast<std::size_t>((degree + 1) * (degree + 1)) - 1;
  if (n > 0xffffffffu) fail(ErrorKind::data, "{}: too many splats for SPZ", path.string());
  std::vector<std::byte> out;
  const auto word = [&](std::uint32_t v) { put_number(out, v); };
  word(kSpzMagic), word(3), word(static_cast<std::uint32_t>(n));
  for (const int v : {degree, bits, splats.antialiased ? 1 : 0, 0}) out.push_back(static_cast<std::byte>(v));
  for (const auto& p : splats.positions)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto v = static_cast<std::int32_t>(std::lround(std::ldexp(k == 0 ? p[k] : -p[k], bits)));
      for (int b = 0; b < 3; ++b) out.push_back(static_cast<std::byte>(v >> 8 * b));
    }
  for (const float logit : splats.opacity_logits) out.push_back(quantise(255 * sigmoid_of(logit)));
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t c = 0; c < 3; ++c)
      out.push_back(quantise((splats.sh[i * 3 * coefficients + c] * kColourScale + 0.5) * 255));
  for (const auto& s : splats.log_scales)
    for (const float v : s) out.push_back(quantise((v + 10) * 16));
  for (const auto& q : splats.rotations) word(pack_rotation({q[0], q[1], -q[2], -q[3]}));
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < 3 * higher; ++k)
      out.push_back(quantise(kHalfTurnSigns[k / 3] * splats.sh[i * 3 * coefficients + 3 + k] * 128 + 128));
  write_file_atomically(path, deflate_gzip(out));
}

std::vector<std::string> spz_remarks(const ImportedSplats& splats) {
  std::vector<std::string> remarks;
  if (const int bits = fraction_bits_for(largest_coordinate(splats)); bits < kFractionBits)
    remarks.push_back(
        fmt::format("positions are rounded to steps of {}, because SPZ has only 24 bits per coordinate",
                    std::ldexp(1.0, -bits)));
  // A value is outside if it exceeds the range of 8 bits by more than half a quantisation step.
  const auto outside = [&](std::size_t i) {
    const std::size_t n = 3 * splats.coefficients();
    const auto over = [](float v, double low, double high) { return !(v >= low && v <= high); };
    for (const float v : splats.log_scales[i])
      if (over(v, -10 - 0.5 / 16, 255.0 / 16 - 10 + 0.5 / 16)) return true;
    for (std::size_t k = 0; k < n; ++k) {
      const double most = k < 3 ? (0.5 + 0.5 / 255) / kColourScale : 1 + 0.5 / 128;
      if (over(splats.sh[i * n + k], -most, most)) return true;
    }
    return false;
  };
  std::size_t clipped = 0;
  for (std::size_t i = 0; i < splats.count(); ++i) clipped += outside(i);
  if (clipped > 0)
    remarks.push_back(fmt::format(
        "{} splats have scales, colours or spherical harmonics beyond the range of SPZ: clipped", clipped));
  return remarks;
}

}  // namespace ubs
