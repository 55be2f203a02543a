// SPDX-License-Identifier: Apache-2.0
// Reads glTF 2.0 with KHR_gaussian_splatting (kernel "ellipse"), and writes binary files; see
// foreign_formats.hpp. Scales and opacities are stored directly, and not as logarithms and logits. The order
// of quaternions is x y z w. Each coefficient of the spherical harmonics is a VEC3 with the values of the
// three colour channels.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <set>
#include <stdexcept>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/memory_limit.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/gltf_file.hpp"
#include "host/formats/gltf_nodes.hpp"
#include "host/formats/splat_transform.hpp"

namespace ubs {
namespace {

constexpr std::uint32_t kGlbMagic = 0x46546c67;
constexpr const char* kSplatting = "KHR_gaussian_splatting";
// Extensions that a file may require. The second one allows integers in accessors.
constexpr std::string_view kSupported[] = {kSplatting, "KHR_mesh_quantization", kInstancing,
                                           "KHR_node_visibility"};
constexpr std::size_t kLeastSplatBytes = 14;

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
    Json accessor{
        {"bufferView", views_.size()}, {"componentType", kGltfFloat}, {"count", count}, {"type", type}};
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
    word(text.size()), word(kGltfJsonChunk);
    const auto words = std::as_bytes(std::span(text));
    out.insert(out.end(), words.begin(), words.end());
    word(bytes_.size()), word(kGltfBinChunk);
    out.insert(out.end(), bytes_.begin(), bytes_.end());
    return out;
  }

 private:
  std::vector<std::byte> bytes_;
  Json views_ = Json::array(), accessors_ = Json::array();
};

// ---- Reading ----

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

// SplatAttributes finds the attributes of a primitive. Early drafts of the extension used the names
// _ROTATION, _SCALE and _SH_DEGREE_1_COEF_0, and stored the colour and the opacity in COLOR_0.
class SplatAttributes {
 public:
  SplatAttributes(const Json& attributes, const std::string& name) : attributes_(attributes), name_(name) {}

  bool has(const std::string& semantic) const { return !key_of(semantic).empty(); }

  // Returns the accessor of an attribute, which counts as used.
  std::size_t take(const std::string& semantic) {
    const std::string key = key_of(semantic);
    if (key.empty()) fail(ErrorKind::data, "{}: the attribute {} is missing", name_, semantic);
    if (key != semantic) early_ = true;
    used_.insert(key);
    return attributes_.at(key).get<std::size_t>();
  }

  // Returns whether COLOR_0 stores a quantity that has no attribute of its own. Other files have COLOR_0 only
  // for viewers that do not support the extension.
  bool in_colour(const std::string& semantic) const {
    return !has(semantic) && attributes_.contains("COLOR_0");
  }

  void note(LoadReport& report) const {
    if (early_) report.note("attributes have the names of an early draft of KHR_gaussian_splatting");
    std::vector<std::string> others;
    for (const auto& [key, value] : attributes_.items())
      if (!used_.contains(key) && key != "COLOR_0") others.push_back(key);
    if (!others.empty()) report.note(fmt::format("attributes that are not used: {}", list_names(others)));
  }

 private:
  std::string key_of(const std::string& semantic) const {
    if (attributes_.contains(semantic)) return semantic;
    const std::size_t colon = semantic.find(':');
    if (colon == std::string::npos) return {};
    const std::string early = "_" + semantic.substr(colon + 1);
    return attributes_.contains(early) ? early : std::string();
  }

  const Json& attributes_;
  const std::string& name_;
  std::set<std::string> used_;
  bool early_ = false;
};

// Reads one primitive. `before` is the number of splats in the primitives before this one. Each splat has at
// least 14 numbers of at least one byte, and we assume that primitives do not share data. So the size of the
// buffers limits the number of splats, and a small damaged file that states a huge number is rejected.
ImportedSplats read_primitive(GltfFile& file, const Json& primitive, std::size_t before) {
  const std::string& name = file.name();
  const Json& stored = primitive.at("attributes");
  SplatAttributes attributes(stored, name);
  const std::size_t places = attributes.take("POSITION");
  const std::size_t count = file.count(places);
  file.load(places);
  for (const char* key : {"ROTATION", "SCALE"}) file.load(attributes.take(attribute(key)));
  for (const auto& [key, value] : stored.items())
    if (key.find("SH_DEGREE_") != std::string::npos) file.load(value.get<std::size_t>());
  if (const std::size_t most = file.loaded_bytes() / kLeastSplatBytes; count > most || before > most - count)
    fail(ErrorKind::data, "{}: {} splats, in addition to {} of other primitives, do not fit into the file",
         name, count, before);
  const auto get = [&](const std::string& key, std::size_t width) {
    return file.read(attributes.take(key), width, count);
  };
  const std::vector<float> place = get("POSITION", 3), rotation = get(attribute("ROTATION"), 4);
  const auto accessor = [&](const std::string& key) {
    return fmt::format("{}: accessor {} ({})", name, attributes.take(attribute(key.c_str())), key);
  };
  ImportedSplats splats;
  const std::vector<float> scale =
      log_scales_of(get(attribute("SCALE"), 3), accessor("SCALE"), splats.report);
  const bool opacity_in_colour = attributes.in_colour(attribute("OPACITY")),
             colour_in_colour = attributes.in_colour(sh_name(0, 0));
  std::vector<float> colour, opacity;
  std::size_t width = 3;
  if (opacity_in_colour || colour_in_colour) {
    const std::size_t at = attributes.take("COLOR_0");
    width = opacity_in_colour || file.type(at) == "VEC4" ? 4 : 3;
    colour = file.read(at, width, count);
    splats.report.note(
        "COLOR_0 is the colour or the opacity of the splats, as in an early draft of the extension");
  }
  if (opacity_in_colour) {
    for (std::size_t i = 0; i < count; ++i) opacity.push_back(colour[4 * i + 3]);
    check_opacities(opacity, fmt::format("{}: COLOR_0", name));
  } else {
    opacity = get(attribute("OPACITY"), 1);
    check_opacities(opacity, accessor("OPACITY"));
  }
  while (splats.sh_degree < 3 && attributes.has(sh_name(splats.sh_degree + 1, 0))) ++splats.sh_degree;
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
      const bool plain = coefficient == 0 && colour_in_colour;
      const std::vector<float> values = plain ? std::vector<float>() : get(sh_name(degree, order), 3);
      for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
          splats.sh[(i * splats.coefficients() + coefficient) * 3 + c] =
              plain ? static_cast<float>((colour[width * i + c] - 0.5) / kShC0) : sign * values[3 * i + c];
    }
  if (primitive.contains("indices"))
    splats.report.note("the indices of primitives are not used: all splats are read");
  attributes.note(splats.report);
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
  if (splatting.contains("quantizedPositionScale"))
    fail(ErrorKind::data, "{}: quantizedPositionScale, of an early draft of {}, is not supported", name,
         kSplatting);
  if (const auto kernel = splatting.value("kernel", "ellipse"); kernel != "ellipse")
    fail(ErrorKind::data, "{}: kernel '{}' is not supported, only 'ellipse'", name, kernel);
}

}  // namespace

void write_glb(const std::filesystem::path& path, const ImportedSplats& splats) {
  const std::size_t n = splats.count(), coefficients = splats.coefficients();
  const int degree = std::min(splats.sh_degree, 3);
  require_splats(path, splats);
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

namespace {

// Returns the extension that holds the splats of a primitive, or null if the primitive has no splats. Refuses
// other extensions for splats, such as those for compression.
const Json* splatting_of(const Json& primitive, const std::string& name) {
  if (!primitive.contains("extensions")) return nullptr;
  const Json& extensions = primitive["extensions"];
  for (const auto& [extension, value] : extensions.items())
    if (extension != kSplatting && extension.find("gaussian_splat") != std::string::npos)
      refuse_extension(extension, name);
  return extensions.contains(kSplatting) ? &extensions[kSplatting] : nullptr;
}

// Appends the splats of one mesh, at each of its places, to `splats`. `read` is the number of splats that
// were read before. Returns the number of splats of the mesh.
std::size_t append_mesh(GltfFile& file, const Json& mesh, const std::vector<Affine>& places, std::size_t read,
                        std::optional<ImportedSplats>& splats) {
  std::size_t count = 0;
  for (const Json& primitive : mesh.at("primitives")) {
    const Json* const extension = splatting_of(primitive, file.name());
    if (!extension) continue;
    check_kernel(*extension, file.name());
    const ImportedSplats part = read_primitive(file, primitive, read + count);
    count += part.count();
    if (places.size() > 1) {
      const double bytes =
          (44.0 + 12.0 * static_cast<double>(part.coefficients())) * static_cast<double>(part.count());
      require_memory(static_cast<std::uint64_t>(std::min(1e18, bytes * static_cast<double>(places.size()))),
                     fmt::format("{}: {} copies of {} splats", file.name(), places.size(), part.count()));
    }
    for (const Affine& place : places) {
      ImportedSplats copy = part;
      transform_splats(copy, half_turned(place));
      if (const auto space = extension->value("colorSpace", ""); space.starts_with("lin"))
        copy.report.note(
            fmt::format("colours in linear light ({}) are not converted and will look too dark", space));
      if (splats)
        append(*splats, copy);
      else
        splats = std::move(copy);
    }
  }
  return count;
}

ImportedSplats splats_of(GltfFile& file) {
  const std::string& name = file.name();
  check_required(file.json(), name);
  const Json& meshes = file.json().at("meshes");
  LoadReport report;
  const MeshPlaces places = find_mesh_places(file, report);
  std::vector<std::size_t> with_splats;
  std::size_t without = 0;
  for (std::size_t m = 0; m < meshes.size(); ++m) {
    bool any = false;
    for (const Json& primitive : meshes[m].at("primitives"))
      if (splatting_of(primitive, name))
        any = true;
      else
        ++without;
    if (any) with_splats.push_back(m);
  }
  if (with_splats.empty())
    fail(ErrorKind::data, "{}: this glTF file has {} primitives, but none with splats ({})", name, without,
         kSplatting);
  const auto shown = [&](std::size_t m) { return places.contains(m); };
  const auto not_shown =
      with_splats.size() - static_cast<std::size_t>(std::ranges::count_if(with_splats, shown));
  const bool none = not_shown == with_splats.size();
  if (none && file.json().contains("nodes"))
    report.note("no node shows the splats: they are read without a transformation");
  else if (not_shown > 0 && !none)
    report.note(
        fmt::format("{} meshes with splats are not used, because the scene does not show them", not_shown));
  std::optional<ImportedSplats> splats;
  std::size_t read = 0;
  for (const std::size_t m : with_splats)
    if (none || shown(m))
      read += append_mesh(file, meshes[m], none ? std::vector<Affine>(1) : places.at(m), read, splats);
  for (const std::string& note : report.notes) splats->report.note(note);
  if (without > 0) splats->report.note(fmt::format("{} primitives without splats are not used", without));
  if (file.json().contains("animations") && !file.json()["animations"].empty())
    splats->report.note("animations are ignored: the splats are static");
  return std::move(*splats);
}

ImportedSplats read_gltf_file(std::span<const std::byte> bytes, const std::string& name,
                              const std::filesystem::path& path) {
  GltfFile file(bytes, name, path);
  try {
    ImportedSplats splats = splats_of(file);
    splats.report.layout = "glTF";
    splats.report.folder = name;
    clean(splats);
    return splats;
  } catch (const nlohmann::json::exception& error) {
    fail(ErrorKind::data, "{}: the JSON does not match the format: {}", name, error.what());
  } catch (const std::out_of_range&) {
    fail(ErrorKind::data, "{}: the JSON refers to an object that does not exist", name);
  }
}

}  // namespace

ImportedSplats parse_glb(std::span<const std::byte> file, const std::string& name) {
  return read_gltf_file(file, name, {});
}

ImportedSplats read_gltf(const std::filesystem::path& path) {
  const std::vector<std::byte> bytes = read_file(path);
  return read_gltf_file(bytes, path.string(), path);
}

}  // namespace ubs
