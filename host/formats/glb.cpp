// SPDX-License-Identifier: Apache-2.0
// Reads and writes binary glTF 2.0 with KHR_gaussian_splatting (kernel "ellipse"); see foreign_formats.hpp. A
// file has a header, a chunk of JSON and a chunk of numbers. Scales and opacities are stored directly, and
// not as logarithms and logits. The order of quaternions is x y z w. Each coefficient of the spherical
// harmonics is a VEC3 with the values of the three colour channels.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <set>

#include "host/base/byte_reader.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

constexpr std::uint32_t kGlbMagic = 0x46546c67, kJsonChunk = 0x4e4f534a, kBinChunk = 0x004e4942;
constexpr const char* kSplatting = "KHR_gaussian_splatting";
// Extensions that a file may require. The second one allows integers in accessors.
constexpr std::string_view kSupported[] = {kSplatting, "KHR_mesh_quantization"};
constexpr int kFloat = 5126;
constexpr std::size_t kLeastSplatBytes = 14;
// The rotation, the scale and the matrix of a node are treated as the identity if their numbers differ by at
// most this much from those of the identity. This allows a few rounding errors of float32 numbers near 1.
constexpr double kNodeRounding = 1e-6;

std::string sh_name(int degree, int order) {
  return fmt::format("{}:SH_DEGREE_{}_COEF_{}", kSplatting, degree, order);
}
std::string attribute(const char* name) { return fmt::format("{}:{}", kSplatting, name); }

// ---- Writing ----

class GlbWriter {
 public:
  // Adds an accessor with `width` numbers per splat and returns its index. Number k of splat i is at(i, k).
  // With `bounds`, the minimum and the maximum over all splats are stored too, for each of the `width`
  // numbers.
  template <typename At>
  std::size_t add(std::size_t count, std::size_t width, At at, bool bounds = false) {
    const std::size_t begin = bytes_.size();
    std::vector<float> low(width, INFINITY), high(width, -INFINITY);
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t k = 0; k < width; ++k) {
        const float v = at(i, k);
        low[k] = std::min(low[k], v), high[k] = std::max(high[k], v);
        const auto raw = std::bit_cast<std::array<std::byte, 4>>(v);
        bytes_.insert(bytes_.end(), raw.begin(), raw.end());
      }
    const char* type = width == 1 ? "SCALAR" : width == 3 ? "VEC3" : "VEC4";
    Json accessor{{"bufferView", views_.size()}, {"componentType", kFloat}, {"count", count}, {"type", type}};
    if (bounds) accessor["min"] = low, accessor["max"] = high;
    views_.push_back({{"buffer", 0}, {"byteOffset", begin}, {"byteLength", bytes_.size() - begin}});
    accessors_.push_back(std::move(accessor));
    return accessors_.size() - 1;
  }

  std::vector<std::byte> finish(Json document) {
    document["accessors"] = accessors_;
    document["bufferViews"] = views_;
    document["buffers"] = {{{"byteLength", bytes_.size()}}};
    std::string text = json_text(document);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::vector<std::byte> out;
    const auto word = [&out](std::size_t v) { put_number(out, static_cast<std::uint32_t>(v)); };
    word(kGlbMagic), word(2), word(12 + 8 + text.size() + 8 + bytes_.size());
    word(text.size()), word(kJsonChunk);
    const auto words = std::as_bytes(std::span(text));
    out.insert(out.end(), words.begin(), words.end());
    word(bytes_.size()), word(kBinChunk);
    out.insert(out.end(), bytes_.begin(), bytes_.end());
    return out;
  }

 private:
  std::vector<std::byte> bytes_;
  Json views_ = Json::array(), accessors_ = Json::array();
};

// ---- Reading ----

struct GlbFile {
  Json json;
  std::span<const std::byte> bin;
};

GlbFile open_glb(std::span<const std::byte> file, const std::string& name) {
  ByteReader in(file, name);
  if (file.size() < 20 || in.read<std::uint32_t>() != kGlbMagic)
    fail(ErrorKind::data, "{}: not a binary glTF file", name);
  if (const auto version = in.read<std::uint32_t>(); version != 2)
    fail(ErrorKind::data, "{}: glTF version {} is not supported, only 2", name, version);
  in.skip(4);
  GlbFile glb;
  bool first = true;
  while (in.remaining() >= 8) {
    const auto size = in.read<std::uint32_t>(), kind = in.read<std::uint32_t>();
    const auto bytes = in.take(size);
    if (first && kind != kJsonChunk)
      fail(ErrorKind::data, "{}: the file does not start with its JSON chunk", name);
    if (first) {
      glb.json = parse_json({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, name);
      limit_members(glb.json, name);
    }
    if (kind == kBinChunk && glb.bin.empty()) glb.bin = bytes;
    first = false;
  }
  return glb;
}

struct Component {
  std::size_t bytes = 4;
  double most = 1;  // value that represents 1 if the accessor is normalised
};
Component component_of(int type, const std::string& name) {
  switch (type) {
    case 5120:
      return {1, 127};
    case 5121:
      return {1, 255};
    case 5122:
      return {2, 32767};
    case 5123:
      return {2, 65535};
    case kFloat:
      return {4, 1};
    default:
      fail(ErrorKind::data, "{}: numbers of type {} are not supported", name, type);
  }
}

float component_at(const std::byte* at, int type) {
  const auto number = [at]<typename T>(T value) {
    std::memcpy(&value, at, sizeof value);
    return static_cast<float>(value);
  };
  switch (type) {
    case 5120:
      return number(std::int8_t{});
    case 5121:
      return number(std::uint8_t{});
    case 5122:
      return number(std::int16_t{});
    case 5123:
      return number(std::uint16_t{});
    default:
      return number(0.0f);
  }
}

// Reads all numbers of an accessor with `width` numbers per element.
std::vector<float> read_accessor(const GlbFile& glb, std::size_t index, std::size_t width, std::size_t count,
                                 const std::string& name) {
  const Json& accessor = glb.json.at("accessors").at(index);
  if (accessor.contains("sparse")) fail(ErrorKind::data, "{}: sparse accessors are not supported", name);
  if (accessor.at("count").get<std::size_t>() != count)
    fail(ErrorKind::data, "{}: accessor {} has a different number of splats than POSITION", name, index);
  const char* const type = width == 1 ? "SCALAR" : width == 3 ? "VEC3" : "VEC4";
  if (accessor.at("type").get<std::string>() != type)
    fail(ErrorKind::data, "{}: accessor {} is not of the type {}", name, index, type);
  const int kind = accessor.at("componentType").get<int>();
  const Component component = component_of(kind, name);
  if (!accessor.contains("bufferView"))
    fail(ErrorKind::data, "{}: accessor {} has no bufferView, so its values are missing", name, index);
  const Json& view = glb.json.at("bufferViews").at(accessor.at("bufferView").get<std::size_t>());
  if (view.at("buffer").get<std::size_t>() != 0 || glb.json.at("buffers").at(0).contains("uri"))
    fail(ErrorKind::data, "{}: values in a separate file are not supported", name);
  const std::size_t stride = view.value("byteStride", width * component.bytes);
  const std::size_t inside = accessor.value("byteOffset", std::size_t{0});
  const std::size_t begin = view.value("byteOffset", std::size_t{0}),
                    size = view.at("byteLength").get<std::size_t>();
  if (begin > glb.bin.size() || size > glb.bin.size() - begin || inside > size ||
      stride < width * component.bytes || stride > 252 ||
      (count > 0 && (size - inside < width * component.bytes ||
                     (size - inside - width * component.bytes) / stride < count - 1)))
    fail(ErrorKind::data, "{}: accessor {} does not fit into the file, or its stride is invalid", name,
         index);
  const bool normalised = accessor.value("normalized", false);
  std::vector<float> values;
  values.reserve(count * width);
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < width; ++k) {
      const float v = component_at(glb.bin.data() + begin + inside + i * stride + k * component.bytes, kind);
      values.push_back(normalised ? std::max(-1.0f, v / static_cast<float>(component.most)) : v);
    }
  return values;
}

std::string range_text(std::span<const float> values) {
  const auto [low, high] = std::ranges::minmax(values);
  return fmt::format("{:.4g} to {:.4g}", low, high);
}

// Returns the logarithms of the scales. The extension stores linear scales. Exporters that followed an early
// draft wrote logarithms, which are negative for all splats smaller than one unit. So the scales of a file
// are treated as logarithms if more than half of them are negative.
std::vector<float> log_scales_of(std::vector<float> scales, const std::string& where, LoadReport& report) {
  const auto negative =
      static_cast<std::size_t>(std::ranges::count_if(scales, [](float v) { return v < 0; }));
  if (2 * negative > scales.size()) {
    report.note(fmt::format(
        "{}: scales from {} are interpreted as logarithms, although the extension defines linear scales",
        where, range_text(scales)));
    return scales;
  }
  if (negative > 0)
    fail(ErrorKind::data,
         "{}: scales from {} are neither linear, as the extension defines them, nor logarithms", where,
         range_text(scales));
  for (float& v : scales) v = std::log(v);
  return scales;
}

void check_opacities(std::span<const float> opacities, const std::string& where) {
  constexpr float kRounding = 1e-5f;
  if (std::ranges::any_of(opacities, [](float v) { return v < -kRounding || v > 1 + kRounding; }))
    fail(ErrorKind::data,
         "{}: opacities from {} are outside of 0 to 1, the range of the extension (the file may contain "
         "logits)",
         where, range_text(opacities));
}

// Adds a note that names the attributes that are not used. COLOR_0 is not named, because it is only meant for
// viewers that do not support the extension.
void note_unused(const Json& attributes, int sh_degree, LoadReport& report) {
  std::vector<std::string> used{"POSITION", "COLOR_0", attribute("ROTATION"), attribute("SCALE"),
                                attribute("OPACITY")};
  for (int degree = 0; degree <= sh_degree; ++degree)
    for (int order = 0; order < 2 * degree + 1; ++order) used.push_back(sh_name(degree, order));
  std::vector<std::string> others;
  for (const auto& [key, value] : attributes.items())
    if (std::ranges::find(used, key) == used.end()) others.push_back(key);
  if (!others.empty()) report.note(fmt::format("attributes that are not used: {}", list_names(others)));
}

// Reads one primitive. `before` is the number of splats in the primitives before this one. Each splat has at
// least 14 numbers of at least one byte, and we assume that primitives do not share data. So the file size
// limits the number of splats, and a small damaged file that states a huge number is rejected.
ImportedSplats read_primitive(const GlbFile& glb, const Json& primitive, std::size_t before,
                              const std::string& name) {
  const Json& attributes = primitive.at("attributes");
  const auto index = [&](const std::string& key) {
    if (!attributes.contains(key)) fail(ErrorKind::data, "{}: the attribute {} is missing", name, key);
    return attributes.at(key).get<std::size_t>();
  };
  const std::size_t count = glb.json.at("accessors").at(index("POSITION")).at("count").get<std::size_t>();
  if (const std::size_t most = glb.bin.size() / kLeastSplatBytes; count > most || before > most - count)
    fail(ErrorKind::data, "{}: {} splats, in addition to {} of other primitives, do not fit into the file",
         name, count, before);
  const auto get = [&](const std::string& key, std::size_t width) {
    return read_accessor(glb, index(key), width, count, name);
  };
  const std::vector<float> place = get("POSITION", 3), rotation = get(attribute("ROTATION"), 4),
                           opacity = get(attribute("OPACITY"), 1);
  const auto accessor = [&](const char* key) {
    return fmt::format("{}: accessor {} ({})", name, index(attribute(key)), key);
  };
  ImportedSplats splats;
  const std::vector<float> scale =
      log_scales_of(get(attribute("SCALE"), 3), accessor("SCALE"), splats.report);
  check_opacities(opacity, accessor("OPACITY"));
  while (splats.sh_degree < 3 && attributes.contains(sh_name(splats.sh_degree + 1, 0))) ++splats.sh_degree;
  splats.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float* const p = &place[3 * i];
    const float* const q = &rotation[4 * i];
    splats.positions[i] = {p[0], -p[1], -p[2]};
    splats.rotations[i] = {q[3], q[0], -q[1], -q[2]};
    for (std::size_t k = 0; k < 3; ++k) splats.log_scales[i][k] = scale[3 * i + k];
    splats.opacity_logits[i] = logit_of(opacity[i]);
  }
  std::size_t coefficient = 0;
  for (int degree = 0; degree <= splats.sh_degree; ++degree)
    for (int order = 0; order < 2 * degree + 1; ++order, ++coefficient) {
      const float sign = coefficient == 0 ? 1.0f : kHalfTurnSigns[coefficient - 1];
      const std::vector<float> values = get(sh_name(degree, order), 3);
      for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
          splats.sh[(i * splats.coefficients() + coefficient) * 3 + c] = sign * values[3 * i + c];
    }
  note_unused(attributes, splats.sh_degree, splats.report);
  return splats;
}

[[noreturn]] void refuse_extension(const std::string& extension, const std::string& name) {
  fail(ErrorKind::data,
       "{}: the extension {} is not supported: export the splats without it, or as PLY or SPZ, with the "
       "program "
       "that wrote the file",
       name, extension);
}

// Throws if the file requires an extension that this reader does not support.
void check_required(const Json& json, const std::string& name) {
  if (!json.contains("extensionsRequired")) return;
  for (const Json& required : json["extensionsRequired"])
    if (const auto extension = required.get<std::string>();
        std::ranges::find(kSupported, extension) == std::end(kSupported))
      refuse_extension(extension, name);
}

// Throws if the splats of a primitive have another kernel than ellipses, or if another extension describes
// them, for example compression.
void check_kernel(const Json& splatting, const std::string& name) {
  if (splatting.contains("extensions"))
    for (const auto& [extension, value] : splatting["extensions"].items()) refuse_extension(extension, name);
  if (const auto kernel = splatting.value("kernel", "ellipse"); kernel != "ellipse")
    fail(ErrorKind::data, "{}: kernel '{}' is not supported, only 'ellipse'", name, kernel);
}

template <std::size_t N>
std::array<double, N> node_numbers(const Json& node, const char* key, std::array<double, N> absent) {
  if (node.contains(key)) node[key].get_to(absent);
  return absent;
}

template <std::size_t N>
void require_neutral(const char* key, const std::array<double, N>& values,
                     const std::array<double, N>& neutral, const std::string& name) {
  for (std::size_t k = 0; k < N; ++k)
    if (std::abs(values[k] - neutral[k]) > kNodeRounding)
      fail(ErrorKind::data, "{}: a node has a {}, but only translations are supported", name, key);
}

// Returns the translation of a node. Throws Error(data) if the node rotates or scales. Many exporters write
// rotations, scales and matrices that have no effect; these are accepted.
std::array<double, 3> place_of_node(const Json& node, const std::string& name) {
  const auto q = node_numbers<4>(node, "rotation", {0, 0, 0, 1});
  require_neutral("rotation", q, {0, 0, 0, std::copysign(1.0, q[3])}, name);  // -q is the same rotation as q
  require_neutral("scale", node_numbers<3>(node, "scale", {1, 1, 1}), {1, 1, 1}, name);
  const auto m = node_numbers<16>(node, "matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  require_neutral("matrix", m, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, m[12], m[13], m[14], 1}, name);
  return node_numbers<3>(node, "translation", {m[12], m[13], m[14]});
}

// MeshPlaces finds the translations of all meshes, in time proportional to the number of nodes.
class MeshPlaces {
 public:
  MeshPlaces(const Json& json, const std::string& name) : name_(name) {
    if (!json.contains("nodes")) return;
    nodes_ = &json.at("nodes");
    parents_.assign(nodes_->size(), nodes_->size());
    places_.resize(nodes_->size());
    for (std::size_t n = 0; n < nodes_->size(); ++n) {
      const Json& node = (*nodes_)[n];
      if (node.contains("mesh")) {
        const auto mesh = node["mesh"].get<std::size_t>();
        if (!of_mesh_.emplace(mesh, n).second) repeated_.insert(mesh);
      }
      if (node.contains("children"))
        for (const Json& child : node["children"]) parents_.at(child.get<std::size_t>()) = n;
    }
  }

  // Returns the sum of the translations of the node that refers to the mesh and of all nodes above it,
  // converted to the axes of PLY files. Returns zero if no node refers to the mesh.
  std::array<double, 3> of(std::size_t mesh) {
    if (repeated_.contains(mesh))
      fail(ErrorKind::data, "{}: two nodes refer to mesh {}, but only one is supported", name_, mesh);
    const auto found = of_mesh_.find(mesh);
    if (found == of_mesh_.end()) return {};
    std::vector<std::size_t> path;
    std::size_t at = found->second;
    for (; at < parents_.size() && !places_[at]; at = parents_[at]) {
      path.push_back(at);
      if (path.size() > parents_.size())
        fail(ErrorKind::data, "{}: the nodes of the scene form a cycle", name_);
    }
    std::array<double, 3> place = at < parents_.size() ? *places_[at] : std::array<double, 3>{};
    for (; !path.empty(); path.pop_back()) {
      const auto by = place_of_node((*nodes_)[path.back()], name_);
      for (std::size_t k = 0; k < 3; ++k) place[k] += k == 0 ? by[k] : -by[k];
      places_[path.back()] = place;
    }
    return place;
  }

 private:
  const std::string& name_;
  const Json* nodes_ = nullptr;
  std::vector<std::size_t> parents_;  // the number of nodes, if there is no parent
  std::vector<std::optional<std::array<double, 3>>> places_;
  std::map<std::size_t, std::size_t> of_mesh_;  // node that refers to a mesh
  std::set<std::size_t> repeated_;              // meshes to which several nodes refer
};

}  // namespace

void write_glb(const std::filesystem::path& path, const ImportedSplats& splats) {
  const std::size_t n = splats.count(), coefficients = splats.coefficients();
  const int degree = std::min(splats.sh_degree, 3);
  if (n == 0) fail(ErrorKind::data, "{}: a glTF file needs at least one splat", path.string());
  if (n > 0xf0000000u / (4 * (11 + 3 * static_cast<std::size_t>((degree + 1) * (degree + 1)))))
    fail(ErrorKind::data, "{}: {} splats do not fit into the 4 GB of a glTF file", path.string(), n);
  GlbWriter out;
  Json attributes{{"POSITION", out.add(
                                   n, 3,
                                   [&](std::size_t i, std::size_t k) {
                                     return k == 0 ? splats.positions[i][k] : -splats.positions[i][k];
                                   },
                                   true)}};
  attributes[attribute("ROTATION")] = out.add(n, 4, [&](std::size_t i, std::size_t k) {
    const auto& q = splats.rotations[i];
    return k == 3 ? q[0] : k == 0 ? q[1] : -q[k + 1];
  });
  attributes[attribute("SCALE")] =
      out.add(n, 3, [&](std::size_t i, std::size_t k) { return std::exp(splats.log_scales[i][k]); });
  attributes[attribute("OPACITY")] =
      out.add(n, 1, [&](std::size_t i, std::size_t) { return sigmoid_of(splats.opacity_logits[i]); });
  std::size_t coefficient = 0;
  for (int d = 0; d <= degree; ++d)
    for (int order = 0; order < 2 * d + 1; ++order, ++coefficient)
      attributes[sh_name(d, order)] = out.add(n, 3, [&](std::size_t i, std::size_t c) {
        const float sign = coefficient == 0 ? 1.0f : kHalfTurnSigns[coefficient - 1];
        return sign * splats.sh[(i * coefficients + coefficient) * 3 + c];
      });
  Json node{{"mesh", 0}};
  if (splats.offset != std::array<double, 3>{})
    node["translation"] = {splats.offset[0], -splats.offset[1], -splats.offset[2]};
  const Json primitive{
      {"attributes", attributes},
      {"mode", 0},
      {"extensions", {{kSplatting, {{"kernel", "ellipse"}, {"colorSpace", "srgb_rec709_display"}}}}}};
  Json document{{"asset", {{"version", "2.0"}, {"generator", "ubs"}}},
                {"extensionsUsed", {kSplatting}},
                {"scene", 0},
                {"scenes", {{{"nodes", {0}}}}},
                {"nodes", {node}},
                {"meshes", {{{"primitives", {primitive}}}}}};
  write_file_atomically(path, out.finish(std::move(document)));
}

ImportedSplats parse_glb(std::span<const std::byte> file, const std::string& name) {
  const GlbFile glb = open_glb(file, name);
  std::optional<ImportedSplats> splats;
  std::string linear;
  std::size_t without = 0;
  bool animated = false;
  try {
    check_required(glb.json, name);
    const Json& meshes = glb.json.at("meshes");
    MeshPlaces places(glb.json, name);
    for (std::size_t m = 0; m < meshes.size(); ++m)
      for (const Json& primitive : meshes[m].at("primitives")) {
        if (!primitive.contains("extensions") || !primitive["extensions"].contains(kSplatting)) {
          ++without;
          continue;
        }
        const Json& extension = primitive["extensions"][kSplatting];
        check_kernel(extension, name);
        if (const auto space = extension.value("colorSpace", ""); space.starts_with("lin")) linear = space;
        ImportedSplats part = read_primitive(glb, primitive, splats ? splats->count() : 0, name);
        part.offset = places.of(m);
        if (splats && splats->offset != part.offset)
          fail(ErrorKind::data, "{}: primitives with different translations are not supported", name);
        if (splats)
          append(*splats, part);
        else
          splats = std::move(part);
      }
    animated = glb.json.contains("animations") && !glb.json["animations"].empty();
  } catch (const nlohmann::json::exception& error) {
    fail(ErrorKind::data, "{}: the JSON does not match the format: {}", name, error.what());
  } catch (const std::out_of_range&) {
    fail(ErrorKind::data, "{}: the JSON refers to an object that does not exist", name);
  }
  if (!splats)
    fail(ErrorKind::data, "{}: this glTF file has {} primitives, but none with splats ({})", name, without,
         kSplatting);
  if (without > 0) splats->report.note(fmt::format("{} primitives without splats are not used", without));
  if (animated) splats->report.note("animations are ignored: the splats are static");
  splats->report.layout = "glTF";
  splats->report.folder = name;
  if (!linear.empty())
    splats->report.note(
        fmt::format("colours in linear light ({}) are not converted and will look too dark", linear));
  clean(*splats);
  return std::move(*splats);
}

ImportedSplats read_glb(const std::filesystem::path& path) {
  return parse_glb(read_file(path), path.string());
}

}  // namespace ubs
