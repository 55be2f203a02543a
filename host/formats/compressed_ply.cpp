// SPDX-License-Identifier: Apache-2.0
// Reads SuperSplat's compressed PLY; see foreign_formats.hpp. The file has these elements:
// - chunk: one row per chunk of 256 splats, with the bounds of the positions and log scales of these splats;
//   since version 2 also with the bounds of their colours
// - vertex: one row per splat. Position and scale have 11+10+11 bits each. Colour and opacity have 4 x 8
//   bits. The rotation has 2 bits for the index of the largest component and 10 bits for each of the other
//   three.
// - sh (optional): one row per splat with the properties f_rest_*, which have 8 bits each. gsplat writes rows
//   without properties if the degree is 0.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "host/base/error.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

constexpr std::size_t kChunk = 256;

float number_at(const std::vector<std::byte>& bytes, std::size_t offset) {
  float value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

std::uint32_t word_at(const std::vector<std::byte>& bytes, std::size_t offset) {
  std::uint32_t value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

float unit(std::uint32_t value, int shift, int bits) {
  const std::uint32_t mask = (1u << bits) - 1;
  return static_cast<float>(value >> shift & mask) / static_cast<float>(mask);
}

std::array<float, 3> unpack_11_10_11(std::uint32_t v) {
  return {unit(v, 21, 11), unit(v, 11, 10), unit(v, 0, 11)};
}

// Decodes a quaternion w x y z. The file stores the index of the largest component, and the other three
// components in the order w x y z as numbers from -sqrt(1/2) to sqrt(1/2).
std::array<float, 4> unpack_rotation(std::uint32_t v) {
  const float stored[3] = {(unit(v, 20, 10) - 0.5f) * std::sqrt(2.0f),
                           (unit(v, 10, 10) - 0.5f) * std::sqrt(2.0f),
                           (unit(v, 0, 10) - 0.5f) * std::sqrt(2.0f)};
  const float rest = stored[0] * stored[0] + stored[1] * stored[1] + stored[2] * stored[2];
  const std::size_t largest = v >> 30;
  std::array<float, 4> q{};
  for (std::size_t i = 0, k = 0; i < 4; ++i)
    q[i] = i == largest ? std::sqrt(std::max(0.0f, 1 - rest)) : stored[k++];
  return q;
}

const PlyElement* find_element(const PlyHeader& header, const std::string& name) {
  const auto it = std::ranges::find(header.elements, name, &PlyElement::name);
  return it == header.elements.end() ? nullptr : &*it;
}

std::size_t offset_of(const PlyElement& element, const std::string& property, PlyType type,
                      const std::string& name) {
  const PlyProperty* found = element.find(property);
  if (!found || found->type != type)
    fail(ErrorKind::data, "{}: property '{}' of element {} is missing or has another type", name, property,
         element.name);
  return found->offset;
}

// Returns the offsets of the properties with the lower and the upper bounds of a quantity. With the axes
// "xyz", these are min_x, min_y, min_z, max_x, max_y and max_z. `what` is inserted before the axis, as in
// min_scale_x.
std::array<std::size_t, 6> bounds_offsets(const PlyElement& chunk, const std::string& what, const char* axes,
                                          const std::string& name) {
  std::array<std::size_t, 6> offsets{};
  for (std::size_t k = 0; k < 6; ++k)
    offsets[k] = offset_of(chunk, fmt::format("{}_{}{}", k < 3 ? "min" : "max", what, axes[k % 3]),
                           PlyType::float32, name);
  return offsets;
}

struct Chunks {
  std::vector<std::byte> bytes;
  std::size_t stride = 0;
  std::array<std::size_t, 6> position{}, scale{}, colour{};
  bool colours = false;

  std::array<float, 3> mix(const std::array<std::size_t, 6>& offsets, std::size_t chunk,
                           const std::array<float, 3>& t) const {
    std::array<float, 3> value{};
    for (std::size_t k = 0; k < 3; ++k) {
      const float low = number_at(bytes, chunk * stride + offsets[k]);
      const float high = number_at(bytes, chunk * stride + offsets[k + 3]);
      value[k] = low + (high - low) * t[k];
    }
    return value;
  }
};

Chunks read_chunks(std::ifstream& stream, const PlyElement& element, const std::string& name) {
  Chunks chunks;
  chunks.stride = element.stride;
  chunks.position = bounds_offsets(element, "", "xyz", name);
  chunks.scale = bounds_offsets(element, "scale_", "xyz", name);
  chunks.colours = element.find("min_r") != nullptr;
  if (chunks.colours) chunks.colour = bounds_offsets(element, "", "rgb", name);
  chunks.bytes = read_ply_bytes(stream, element, name);
  return chunks;
}

// Decodes 8 bits to [-4, 4]. This range is divided into 256 equal intervals, one per code. The code 0 stands
// for -4, the code 255 for 4, and every other code for the middle of its interval.
float unpack_sh(std::uint8_t v) {
  const float t = v == 0 ? 0.0f : v == 255 ? 1.0f : (static_cast<float>(v) + 0.5f) / 256.0f;
  return (t - 0.5f) * 8.0f;
}

void read_sh(std::ifstream& stream, const PlyElement& element, ImportedSplats& splats,
             const std::string& name) {
  const std::size_t higher = splats.coefficients() - 1;
  std::vector<std::size_t> offsets;
  for (std::size_t k = 0; k < 3 * higher; ++k)
    offsets.push_back(offset_of(element, fmt::format("f_rest_{}", k), PlyType::uint8, name));
  const std::vector<std::byte> bytes = read_ply_bytes(stream, element, name);
  for (std::size_t i = 0; i < splats.count(); ++i)
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t k = 0; k < higher; ++k)
        splats.sh[(i * (higher + 1) + k + 1) * 3 + c] =
            unpack_sh(std::to_integer<std::uint8_t>(bytes[i * element.stride + offsets[c * higher + k]]));
}

// Adds a note about the properties of `element` that are not in `names`, because they are not used.
void note_unused(const PlyElement& element, const std::vector<std::string>& names, LoadReport& report) {
  std::vector<const PlyProperty*> used;
  for (const std::string& name : names)
    if (const PlyProperty* property = element.find(name)) used.push_back(property);
  for (const std::string& remark : unused_properties(element, used)) report.note(remark);
}

int degree_of(const PlyElement* sh, const std::string& name) {
  if (!sh) return 0;
  for (int degree = 0; degree <= 3; ++degree)
    if (sh->properties.size() == 3u * static_cast<std::size_t>((degree + 1) * (degree + 1) - 1))
      return degree;
  fail(ErrorKind::data, "{}: element sh has {} properties: expected 0, 9, 24 or 45", name,
       sh->properties.size());
}

}  // namespace

ImportedSplats read_compressed_ply(const std::filesystem::path& path) {
  const std::string name = path.string();
  PlyHeader header;
  std::ifstream stream = open_ply_elements(path, header);
  const PlyElement* vertex = find_element(header, "vertex");
  const PlyElement* sh = find_element(header, "sh");
  if (header.elements[0].name != "chunk" || header.elements.size() < 2 || &header.elements[1] != vertex ||
      header.elements.size() != (sh ? 3u : 2u))
    fail(ErrorKind::data, "{}: expected the elements chunk, vertex and, optionally, sh", name);
  if (const std::size_t chunks = header.elements[0].count, least = (vertex->count + kChunk - 1) / kChunk;
      chunks < least)
    fail(ErrorKind::data, "{}: the file has {} chunks, but {} splats need at least {}", name, chunks,
         vertex->count, least);
  if (sh && sh->count != vertex->count)
    fail(ErrorKind::data, "{}: the element sh has {} rows, but there are {} splats", name, sh->count,
         vertex->count);
  const Chunks chunks = read_chunks(stream, header.elements[0], name);
  std::array<std::size_t, 4> words{};
  constexpr const char* kWords[4] = {"packed_position", "packed_rotation", "packed_scale", "packed_color"};
  for (std::size_t k = 0; k < 4; ++k) words[k] = offset_of(*vertex, kWords[k], PlyType::uint32, name);
  const std::vector<std::byte> bytes = read_ply_bytes(stream, *vertex, name);

  ImportedSplats splats;
  splats.sh_degree = degree_of(sh, name);
  splats.offset = offset_comment(header.comments, name);
  splats.antialiased = antialias_comment(header.comments, splats.report);
  splats.resize(vertex->count);
  for (std::size_t i = 0; i < splats.count(); ++i) {
    const auto word = [&](std::size_t k) { return word_at(bytes, i * vertex->stride + words[k]); };
    const std::size_t chunk = i / kChunk;
    splats.positions[i] = chunks.mix(chunks.position, chunk, unpack_11_10_11(word(0)));
    splats.rotations[i] = unpack_rotation(word(1));
    splats.log_scales[i] = chunks.mix(chunks.scale, chunk, unpack_11_10_11(word(2)));
    const std::uint32_t packed = word(3);
    std::array<float, 3> colour{unit(packed, 24, 8), unit(packed, 16, 8), unit(packed, 8, 8)};
    if (chunks.colours) colour = chunks.mix(chunks.colour, chunk, colour);
    for (std::size_t c = 0; c < 3; ++c)
      splats.sh[i * 3 * splats.coefficients() + c] = static_cast<float>((colour[c] - 0.5) / kShC0);
    splats.opacity_logits[i] = logit_of(unit(packed, 0, 8));
  }
  if (sh) read_sh(stream, *sh, splats, name);
  std::vector<std::string> bounds;
  for (const char* quantity : {"x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"})
    for (const char* end : {"min", "max"}) bounds.push_back(fmt::format("{}_{}", end, quantity));
  note_unused(header.elements[0], bounds, splats.report);
  note_unused(*vertex, {std::begin(kWords), std::end(kWords)}, splats.report);
  splats.report.layout = "SuperSplat compressed PLY";
  splats.report.folder = name;
  clean(splats);
  return splats;
}

}  // namespace ubs
