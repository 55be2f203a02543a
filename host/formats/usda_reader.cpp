// SPDX-License-Identifier: Apache-2.0
// Reads splats from OpenUSD text files; see foreign_formats.hpp.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/splat_transform.hpp"
#include "host/formats/usda_parser.hpp"

namespace ubs {
namespace {

constexpr const char* kSplatType = "ParticleField3DGaussianSplat";

// Returns the nearest number of half precision. OpenUSD prints such numbers with six digits, which is enough
// to distinguish them, but is not their exact value.
float nearest_half(float value) {
  constexpr float kLargest = 65504;
  constexpr int kLeastExponent = -14, kFractionBits = 10;
  if (!(std::abs(value) <= kLargest) || value == 0) return value;
  const int exponent = std::max(std::ilogb(value), kLeastExponent) - kFractionBits;
  return std::ldexp(std::nearbyint(std::ldexp(value, -exponent)), exponent);
}

// Returns the rotation by an angle [degrees] about axis 0, 1 or 2.
Affine usd_turn(std::size_t axis, double angle) {
  const double half = angle * std::numbers::pi / 360;
  std::array<double, 4> q{std::cos(half), 0, 0, 0};
  q[axis + 1] = std::sin(half);
  return rotation(q);
}

// Returns the transformation of an operation such as xformOp:rotateXYZ or xformOp:translate:pivot, or nothing
// if it is not one of the schema.
std::optional<Affine> usd_operation(std::string_view name, const std::vector<double>& v) {
  constexpr std::string_view kPrefix = "xformOp:";
  if (!name.starts_with(kPrefix)) return {};
  std::string_view kind = name.substr(kPrefix.size());
  kind = kind.substr(0, kind.find(':'));
  // Returns the axes that the letters after `what` name, or none if there are other letters.
  const auto axes_after = [kind](std::string_view what) {
    std::vector<std::size_t> axes;
    if (!kind.starts_with(what) || kind.find_first_not_of("XYZ", what.size()) != kind.npos) return axes;
    for (const char letter : kind.substr(what.size())) axes.push_back(static_cast<std::size_t>(letter - 'X'));
    return axes;
  };
  const auto on_axis = [&v](std::size_t axis, double others) {
    Vec3 values{others, others, others};
    values[axis] = v[0];
    return values;
  };
  if (kind == "translate" && v.size() == 3) return translation({v[0], v[1], v[2]});
  if (kind == "scale" && v.size() == 3) return scaling({v[0], v[1], v[2]});
  if (kind == "orient" && v.size() == 4) return rotation({v[0], v[1], v[2], v[3]});
  if (const auto axes = axes_after("translate"); axes.size() == 1 && v.size() == 1)
    return translation(on_axis(axes[0], 0));
  if (const auto axes = axes_after("scale"); axes.size() == 1 && v.size() == 1)
    return scaling(on_axis(axes[0], 1));
  if (const auto axes = axes_after("rotate"); axes.size() == v.size() && (v.size() == 1 || v.size() == 3)) {
    Affine turn;  // the rotation about the first axis of the name is applied first
    for (const std::size_t axis : axes) turn = usd_turn(axis, v.size() == 1 ? v[0] : v[axis]) * turn;
    return turn;
  }
  // OpenUSD multiplies a row with the matrix.
  if (kind != "transform" || v.size() != 16 || !is_affine_row(v[3], v[7], v[11], v[15])) return {};
  Affine affine;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) affine.linear[r][c] = v[4 * c + r];
    affine.move[r] = v[12 + r];
  }
  return affine;
}

class UsdSplatReader {
 public:
  UsdSplatReader(std::string_view text, const std::string& name)
      : name_(name), parser_(text, name), layer_(parser_.parse()) {}

  ImportedSplats read(std::optional<double> time) {
    choose_time(time);
    const auto up = layer_.metadata.find("upAxis");
    const std::string axis = up == layer_.metadata.end() ? "Y" : parser_.read_text(up->second);
    turned_ = axis != "Z";
    std::optional<ImportedSplats> splats;
    std::size_t others = 0;
    for (const UsdPrim& prim : layer_.prims) {
      if (prim.type != kSplatType || !prim.drawn) {
        others += !prim.type.empty() && prim.type != "Xform" && prim.type != "Scope";
        continue;
      }
      ImportedSplats part = read_prim(prim);
      if (splats)
        append(*splats, part);
      else
        splats = std::move(part);
    }
    if (!splats) refuse();
    if (others > 0) splats->report.note(fmt::format("{} prims without splats are not used", others));
    if (!layer_.arcs.empty())
      splats->report.note(fmt::format("composition arcs that are not followed: {}",
                                      list_names({layer_.arcs.begin(), layer_.arcs.end()})));
    if (!turned_) splats->report.note("the z axis points up: coordinates are not converted");
    note_units(*splats);
    note_time(*splats, time.has_value());
    splats->report.layout = "USD";
    splats->report.folder = name_;
    clean(*splats);
    return std::move(*splats);
  }

 private:
  [[noreturn]] void refuse() const {
    const std::string found = layer_.arcs.empty() ? ""
                                                  : fmt::format(
                                                        "; it refers to other layers or variants, which are "
                                                        "not read: flatten it first with 'usdcat --flatten'");
    fail(ErrorKind::data, "{}: this USD file has no splats: it has {} prims, none of the type {}{}", name_,
         layer_.prims.size(), kSplatType, found);
  }

  // Collects the time codes of all splats and chooses the one to read.
  void choose_time(std::optional<double> time) {
    for (const UsdPrim& prim : layer_.prims)
      if (prim.type == kSplatType && prim.drawn)
        for (const auto& [name, property] : prim.properties)
          for (const auto& [code, at] : property.samples) codes_.insert(code);
    if (codes_.empty()) {
      if (time) fail(ErrorKind::usage, "{}: --time requires a file with time samples", name_);
      return;
    }
    code_ = *codes_.begin();
    if (time) code_ = nearest(codes_, code_ + *time * (*codes_.rbegin() - code_));
  }

  static double nearest(const std::set<double>& codes, double wanted) {
    return *std::ranges::min_element(
        codes, [wanted](double a, double b) { return std::abs(a - wanted) < std::abs(b - wanted); });
  }

  const UsdProperty* find(const UsdPrim& prim, std::string_view name) const {
    const auto found = prim.properties.find(name);
    return found == prim.properties.end() ? nullptr : &found->second;
  }

  // Returns the position of a property's value at the chosen time, or kUsdNone if the property has no value.
  std::size_t value_at(const UsdProperty* property) const {
    if (!property) return kUsdNone;
    if (property->samples.empty()) return property->value;
    return std::ranges::min_element(property->samples,
                                    [this](const auto& a, const auto& b) {
                                      return std::abs(a.first - code_) < std::abs(b.first - code_);
                                    })
        ->second;
  }

  // Returns the values of an attribute with `width` numbers per element. Reads the attribute `name` with
  // float values or, if it is missing, the attribute with half-precision values, whose name ends with "h".
  std::vector<float> array_of(const UsdPrim& prim, const std::string& name, std::size_t width) {
    std::vector<float> values;
    const auto has = [&](const std::string& form) {
      const std::size_t at = value_at(find(prim, form));
      return at != kUsdNone && parser_.read_array(at, width, values) && !values.empty();
    };
    if (has(name)) return values;
    if (!has(name + "h")) return {};
    std::ranges::transform(values, values.begin(), nearest_half);
    return values;
  }

  // Returns whether an array is used. The schema requires that an array with too many values is truncated,
  // and that an array with too few values is ignored. Adds a note in both cases, and if the array is missing.
  bool fits(const UsdPrim& prim, const char* name, std::size_t size, std::size_t expected,
            LoadReport& report) {
    if (size == 0) {
      report.note(fmt::format("{}: {} are missing: the schema's default is used", prim.name, name));
      return false;
    }
    if (size < expected)
      report.note(fmt::format(
          "{}: {} values of {} are too few for the number of splats: the schema's default is used", prim.name,
          size, name));
    if (size > expected)
      report.note(fmt::format("{}: {} has more values than the number of splats requires", prim.name, name));
    return size >= expected;
  }

  ImportedSplats read_prim(const UsdPrim& prim) {
    const std::vector<float> places = array_of(prim, "positions", 3);
    const std::size_t count = places.size() / 3;
    ImportedSplats splats;
    std::vector<float> scales = array_of(prim, "scales", 3), opacities = array_of(prim, "opacities", 1);
    const std::vector<float> turns = array_of(prim, "orientations", 4);
    LoadReport& report = splats.report;
    if (count > 0) {
      if (!fits(prim, "scales", scales.size(), 3 * count, report)) scales.assign(3 * count, 1.0f);
      if (!fits(prim, "opacities", opacities.size(), count, report)) opacities.assign(count, 1.0f);
      check_range("scales", "linear scales (the file may contain logarithms)", scales, 0,
                  std::numeric_limits<float>::infinity());
      check_range("opacities", "opacities from 0 to 1 (the file may contain logits)", opacities, 0, 1);
    }
    const bool turns_fit = count > 0 && fits(prim, "orientations", turns.size(), 4 * count, report);
    const std::size_t stored = read_colours(prim, count, splats);
    const float flip = turned_ ? -1.0f : 1.0f;
    splats.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const float* const p = &places[3 * i];
      splats.positions[i] = {p[0], flip * p[1], flip * p[2]};
      splats.rotations[i] = {1, 0, 0, 0};
      if (turns_fit)
        splats.rotations[i] = {turns[4 * i], turns[4 * i + 1], flip * turns[4 * i + 2],
                               flip * turns[4 * i + 3]};
      for (std::size_t k = 0; k < 3; ++k) splats.log_scales[i][k] = std::log(scales[3 * i + k]);
      splats.opacity_logits[i] = logit_of(opacities[i]);
      if (stored == 0) continue;
      for (std::size_t n = 0; n < splats.coefficients(); ++n) {
        const float sign = turned_ && n > 0 ? kHalfTurnSigns[n - 1] : 1.0f;
        for (std::size_t c = 0; c < 3; ++c)
          splats.sh[(i * splats.coefficients() + n) * 3 + c] = sign * colours_[(i * stored + n) * 3 + c];
      }
    }
    const Affine place = place_of(prim);
    transform_splats(splats, turned_ ? half_turned(place) : place);
    note_unused(prim, report);
    return splats;
  }

  // Sets the degree of the spherical harmonics and colours_. Returns the number of coefficients per splat in
  // the file, or 0 if they are missing or cannot be used.
  std::size_t read_colours(const UsdPrim& prim, std::size_t count, ImportedSplats& splats) {
    int degree = 3;  // the schema's default
    if (const std::size_t at = value_at(find(prim, "radiance:sphericalHarmonicsDegree")); at != kUsdNone) {
      const std::vector<double> value = parser_.read_numbers(at);
      if (value.size() != 1 || !(value[0] >= 0 && value[0] <= 10) || value[0] != std::floor(value[0]))
        fail(ErrorKind::data, "{}: {}: the degree of the harmonics must be a whole number from 0 to 10",
             name_, prim.name);
      degree = static_cast<int>(value[0]);
    }
    colours_ = array_of(prim, "radiance:sphericalHarmonicsCoefficients", 3);
    const std::size_t stored = static_cast<std::size_t>((degree + 1) * (degree + 1));
    if (count == 0 || !fits(prim, "harmonics", colours_.size(), 3 * count * stored, splats.report)) return 0;
    if (degree > 3)
      splats.report.note(fmt::format("spherical harmonics of degree 4 to {} are not used", degree));
    splats.sh_degree = std::min(degree, 3);
    return stored;
  }

  void check_range(const char* name, const char* expected, std::span<const float> values, float low,
                   float high) const {
    constexpr float kOver = 1e-5f;
    const auto outside = [=](float v) { return v < low - (high == 1 ? kOver : 0) || v > high + kOver; };
    if (std::ranges::none_of(values, outside)) return;
    const auto [least, most] = std::ranges::minmax(values);
    fail(ErrorKind::data, "{}: values of {} range from {:.4g} to {:.4g}, but the schema requires {}", name_,
         name, least, most, expected);
  }

  // Returns the transformation from the axes of a prim to those of the stage: that of the prim and of all
  // prims above it, up to the first one that ignores the prims above it.
  Affine place_of(const UsdPrim& prim) {
    Affine place;
    for (const UsdPrim* at = &prim;; at = &layer_.prims[at->parent]) {
      if (at->type == "PointInstancer")
        fail(ErrorKind::data, "{}: the prim {} belongs to the PointInstancer {}, which is not supported",
             name_, prim.name, at->name);
      const auto [own, resets] = operations_of(*at);
      place = own * place;
      if (resets || at->parent == kUsdNone) break;
    }
    return place;
  }

  // Returns the transformation of one prim, and whether the prim ignores the prims above it. The last
  // operation of the list is applied first.
  std::pair<Affine, bool> operations_of(const UsdPrim& prim) {
    std::pair<Affine, bool> result;
    const std::size_t order = value_at(find(prim, "xformOpOrder"));
    if (order == kUsdNone) return result;
    for (std::string name : parser_.read_texts(order)) {
      if (name == "!resetXformStack!") {
        result.second = true;
        continue;
      }
      const std::string_view inverted = "!invert!";
      const bool inverts = name.starts_with(inverted);
      if (inverts) name.erase(0, inverted.size());
      const std::size_t at = value_at(find(prim, name));
      if (at == kUsdNone) continue;
      const auto refuse_operation = [&](const char* why) {
        fail(ErrorKind::data, "{}: the prim {} has the operation {}: {}", name_, prim.name, name, why);
      };
      const std::optional<Affine> operation = usd_operation(name, parser_.read_numbers(at));
      if (!operation) refuse_operation("it is not supported");
      if (!is_finite(*operation)) refuse_operation("its value is not a finite transformation");
      const std::optional<Affine> back = inverse(*operation);
      if (!back) refuse_operation("it has no inverse, for example because a scale is 0");
      result.first = result.first * (inverts ? *back : *operation);
    }
    return result;
  }

  static void note_unused(const UsdPrim& prim, LoadReport& report) {
    // `known` contains attributes that are used elsewhere, that have no effect here (extent, hints and the
    // side of surfaces), or that are for programs that do not support the schema (displayColor).
    const std::set<std::string_view> used{"positions", "orientations", "scales", "opacities",
                                          "radiance:sphericalHarmonicsCoefficients"};
    const std::set<std::string_view> known{"radiance:sphericalHarmonicsDegree",
                                           "extent",
                                           "projectionModeHint",
                                           "sortingModeHint",
                                           "doubleSided",
                                           "orientation",
                                           "purpose",
                                           "primvars:displayColor",
                                           "primvars:displayOpacity",
                                           "xformOpOrder"};
    std::vector<std::string> others;
    for (const auto& [name, property] : prim.properties) {
      std::string_view full = name;
      if (full.ends_with('h') && used.contains(full.substr(0, full.size() - 1))) full.remove_suffix(1);
      if (!used.contains(full) && !known.contains(full) && !full.starts_with("xformOp:"))
        others.push_back(name);
    }
    if (!others.empty()) report.note(fmt::format("attributes that are not used: {}", list_names(others)));
  }

  void note_units(ImportedSplats& splats) {
    const auto found = layer_.metadata.find("metersPerUnit");
    if (found == layer_.metadata.end()) return;
    const std::vector<double> units = parser_.read_numbers(found->second);
    if (units.size() == 1 && units[0] != 1)
      splats.report.note(fmt::format("the unit of length is {} m: coordinates are not converted", units[0]));
  }

  void note_time(ImportedSplats& splats, bool chosen) const {
    if (codes_.size() < 2) return;
    splats.report.note(fmt::format("{} time samples, time codes {} to {}: the sample at {} is read{}",
                                   codes_.size(), *codes_.begin(), *codes_.rbegin(), code_,
                                   chosen ? "" : "; 'ubs convert --time' reads another one"));
  }

  const std::string& name_;
  UsdaParser parser_;
  UsdLayer layer_;
  std::set<double> codes_;
  double code_ = 0;
  bool turned_ = true;
  std::vector<float> colours_;
};

}  // namespace

ImportedSplats parse_usda(std::string_view text, const std::string& name, std::optional<double> time) {
  return UsdSplatReader(text, name).read(time);
}

ImportedSplats read_usda(const std::filesystem::path& path) {
  return parse_usda(read_text_file(path), path.string());
}

ImportedSplats read_usda_at(const std::filesystem::path& path, double time) {
  return parse_usda(read_text_file(path), path.string(), time);
}

}  // namespace ubs
