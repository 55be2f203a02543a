// SPDX-License-Identifier: Apache-2.0
// Reads and writes the 32-byte .splat format of web viewers; see foreign_formats.hpp. The format has no
// header, so files are recognised by their extension, and only their size and their values show whether they
// are valid.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "host/base/byte_reader.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

constexpr std::size_t kRecord = 32;

std::uint8_t to_byte(double v) { return static_cast<std::uint8_t>(std::clamp(std::lround(v), 0l, 255l)); }

}  // namespace

ImportedSplats read_splat32(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::vector<std::byte> bytes = read_file(path);
  if (bytes.size() % kRecord != 0)
    fail(ErrorKind::data, "{}: the size of {} bytes is not a multiple of {}, the size of a .splat record",
         name, bytes.size(), kRecord);
  ImportedSplats splats;
  splats.resize(bytes.size() / kRecord);
  ByteReader in(bytes, name);
  for (std::size_t i = 0; i < splats.count(); ++i) {
    for (float& v : splats.positions[i]) v = in.read<float>();
    // The logarithm of a negative scale is NaN, so the splat is dropped.
    for (float& v : splats.log_scales[i]) v = std::log(in.read<float>());
    // A flat splat has one scale of 0. If all three scales are 0, these bytes are not a splat. The format has
    // no header that would tell whether a file contains splats.
    if (std::ranges::all_of(splats.log_scales[i], [](float v) { return v == -INFINITY; }))
      splats.log_scales[i].fill(NAN);
    for (std::size_t c = 0; c < 3; ++c)
      splats.sh[3 * i + c] = static_cast<float>((in.read<std::uint8_t>() / 255.0 - 0.5) / kShC0);
    splats.opacity_logits[i] = logit_of(in.read<std::uint8_t>() / 255.0);
    for (float& v : splats.rotations[i]) v = (static_cast<float>(in.read<std::uint8_t>()) - 128.0f) / 128.0f;
  }
  splats.report.layout = ".splat";
  splats.report.folder = name;
  const std::size_t all = splats.count();
  clean(splats);
  if (all > 0 && splats.count() == 0)
    fail(ErrorKind::data, "{}: not a .splat file: none of its records contains valid values", name);
  return splats;
}

void write_splat32(const std::filesystem::path& path, const ImportedSplats& splats) {
  require_splats(path, splats);
  AtomicFile file(path);
  for (std::size_t i = 0; i < splats.count(); ++i) {
    std::array<float, 6> numbers{};
    for (std::size_t k = 0; k < 3; ++k) {
      numbers[k] = splats.positions[i][k];
      numbers[k + 3] = std::exp(splats.log_scales[i][k]);
    }
    file.write(std::as_bytes(std::span(numbers)));
    std::array<std::uint8_t, 8> bytes{};
    for (std::size_t c = 0; c < 3; ++c)
      bytes[c] = to_byte((splats.sh[i * 3 * splats.coefficients() + c] * kShC0 + 0.5) * 255);
    bytes[3] = to_byte(255 * sigmoid_of(splats.opacity_logits[i]));
    for (std::size_t k = 0; k < 4; ++k) bytes[4 + k] = to_byte(splats.rotations[i][k] * 128 + 128);
    file.write(std::as_bytes(std::span(bytes)));
  }
  file.commit();
}

}  // namespace ubs
