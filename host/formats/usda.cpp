// SPDX-License-Identifier: Apache-2.0
// Writes OpenUSD files with the schema UsdVol ParticleField3DGaussianSplat of OpenUSD 26.03; see
// foreign_formats.hpp. The files are written in text form, which requires no library of OpenUSD. usdc.cpp
// converts them to binary form with programs of OpenUSD. One prim contains all splats. Scales and opacities
// are stored directly, and not as logarithms and logits. The order of quaternions is (w, x, y, z). Spherical
// harmonics are stored splat after splat, with three channels for each coefficient. The splats are rotated by
// 180 degrees about x, because y points up on a stage of USD.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/splat_series.hpp"

namespace ubs {
namespace {

// The extent covers every position at which a splat has an opacity of more than 1/255, the threshold of 3DGS.
// This is sqrt(2 ln 255) standard deviations.
constexpr double kExtentSigmas = 3.3290;
constexpr int kTimeCodesPerSecond = 24;  // the default of USD

constexpr std::size_t kFlushBytes = std::size_t{1} << 20;

// UsdaText is text that is written to a file in blocks. Numbers are written with enough digits for a reader
// to get exactly the same float32 or float64.
class UsdaText {
 public:
  explicit UsdaText(AtomicFile& file) : file_(file) {}

  template <typename... Args>
  void print(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(text_), format, std::forward<Args>(args)...);
    flush_if_large();
  }

  template <std::size_t N>
  void tuple(const std::array<float, N>& values) {
    char digits[32];
    for (std::size_t k = 0; k < N; ++k) {
      if (N > 1) text_ += k == 0 ? '(' : ',';
      text_.append(digits, std::to_chars(digits, digits + sizeof digits, values[k]).ptr);
    }
    if (N > 1) text_ += ')';
    flush_if_large();
  }

  void put(std::string_view text) { text_ += text; }

  void flush() {
    file_.write(text_);
    text_.clear();
  }

 private:
  void flush_if_large() {
    if (text_.size() > kFlushBytes) flush();
  }

  AtomicFile& file_;
  std::string text_;
};

// Writes an array of `count` elements; at(i) returns element i as an array of N floats.
template <std::size_t N, typename At>
void print_usd_array(UsdaText& out, std::size_t count, const At& at) {
  out.put("[");
  for (std::size_t i = 0; i < count; ++i) {
    if (i > 0) out.put(",\n");
    out.tuple<N>(at(i));
  }
  out.put("]");
}

// Writes an attribute once if it is the same at all time samples (`constant`). Otherwise writes the first
// time sample as the default value, for readers that ignore time, and then all time samples. The first
// argument of `count` and `at` is the index of the time sample.
template <std::size_t N, typename Count, typename At>
void print_usd_attribute(UsdaText& out, const char* declaration, std::size_t moments, bool constant,
                         const Count& count, const At& at) {
  const auto array = [&](std::size_t moment) {
    print_usd_array<N>(out, count(moment), [&](std::size_t i) { return at(moment, i); });
  };
  out.print("    {} = ", declaration);
  array(0);
  out.put("\n");
  if (constant) return;
  out.print("    {}.timeSamples = {{\n", declaration);
  for (std::size_t m = 0; m < moments; ++m) {
    out.print("        {}: ", m);
    array(m);
    out.put(",\n");
  }
  out.put("    }\n");
}

// Returns two opposite corners of a box around all splats, in the axes of the stage, rounded outwards.
std::array<std::array<float, 3>, 2> usd_extent(const ImportedSplats& splats) {
  std::array<double, 3> low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};
  for (std::size_t i = 0; i < splats.count(); ++i) {
    const auto& q = splats.rotations[i];
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double rows[3][3] = {{1 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)},
                               {2.0 * (x * y + w * z), 1 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)},
                               {2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1 - 2.0 * (x * x + y * y)}};
    for (std::size_t a = 0; a < 3; ++a) {
      double variance = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const double scale = std::exp(double{splats.log_scales[i][k]});
        variance += rows[a][k] * rows[a][k] * scale * scale;
      }
      const double centre = a == 0 ? splats.positions[i][a] : -splats.positions[i][a];
      const double reach = kExtentSigmas * std::sqrt(variance);
      low[a] = std::min(low[a], centre - reach);
      high[a] = std::max(high[a], centre + reach);
    }
  }
  std::array<std::array<float, 3>, 2> corners{};
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (std::size_t a = 0; a < 3; ++a) {
    corners[0][a] = std::nextafter(static_cast<float>(low[a]), -kInfinity);
    corners[1][a] = std::nextafter(static_cast<float>(high[a]), kInfinity);
  }
  return corners;
}

void check_usd_moment(const std::filesystem::path& path, const ImportedSplats& splats,
                      const std::vector<float>& sh) {
  const auto finite = [](const auto& values) {
    return std::ranges::all_of(values, [](float v) { return std::isfinite(v); });
  };
  for (std::size_t i = 0; i < splats.count(); ++i) {
    const auto colour = std::span(sh).subspan(i * 3 * splats.coefficients(), 3 * splats.coefficients());
    if (!finite(splats.positions[i]) || !finite(splats.log_scales[i]) || !finite(splats.rotations[i]) ||
        !std::isfinite(splats.opacity_logits[i]) || !finite(colour))
      fail(ErrorKind::data, "{}: splat {} has a value that is not finite", path.string(), i);
  }
}

bool same_in_all(std::span<const ImportedSplats> moments, auto ImportedSplats::*values) {
  return std::ranges::all_of(
      moments, [&](const ImportedSplats& splats) { return splats.*values == moments.front().*values; });
}

void write_usd_moments(const std::filesystem::path& path, std::span<const ImportedSplats> moments) {
  const std::size_t n = moments.size();
  for (const ImportedSplats& splats : moments) require_splats(path, splats);
  for (std::size_t m = 0; m < n; ++m) check_usd_moment(path, moments[m], SplatSeries::sh(moments, m));
  const ImportedSplats& first = moments.front();
  const int degree = std::min(first.sh_degree, 3);
  const std::size_t written = static_cast<std::size_t>((degree + 1) * (degree + 1));

  AtomicFile file(path);
  UsdaText out(file);
  out.put("#usda 1.0\n(\n    customLayerData = {\n        string creator = \"ubs\"\n    }\n");
  out.put("    defaultPrim = \"Splats\"\n");
  if (n > 1) out.print("    endTimeCode = {}\n    framesPerSecond = {}\n", n - 1, kTimeCodesPerSecond);
  out.put("    metersPerUnit = 1\n");
  if (n > 1) out.print("    startTimeCode = 0\n    timeCodesPerSecond = {}\n", kTimeCodesPerSecond);
  out.put("    upAxis = \"Y\"\n)\n\ndef ParticleField3DGaussianSplat \"Splats\"\n{\n");

  const auto count = [&](std::size_t m) { return moments[m].count(); };
  const bool same_count = std::ranges::all_of(
      moments, [&](const ImportedSplats& splats) { return splats.count() == first.count(); });
  const bool same_places = same_in_all(moments, &ImportedSplats::positions);
  const bool same_scales = same_in_all(moments, &ImportedSplats::log_scales);
  const bool same_rotations = same_in_all(moments, &ImportedSplats::rotations);
  const bool same_colours = same_count && std::ranges::all_of(moments.subspan(1), [](const auto& splats) {
                              return splats.sh.empty();
                            });
  std::vector<std::array<std::array<float, 3>, 2>> extents;
  if (same_places && same_scales && same_rotations)
    extents.push_back(usd_extent(first));
  else
    for (const ImportedSplats& splats : moments) extents.push_back(usd_extent(splats));
  print_usd_attribute<3>(
      out, "float3[] extent", n, extents.size() == 1, [](std::size_t) { return std::size_t{2}; },
      [&](std::size_t m, std::size_t i) { return extents[m][i]; });
  out.put("    uniform token projectionModeHint = \"perspective\"\n");
  out.put("    uniform token sortingModeHint = \"zDepth\"\n");
  print_usd_attribute<3>(out, "point3f[] positions", n, same_places, count,
                         [&](std::size_t m, std::size_t i) {
                           const auto& p = moments[m].positions[i];
                           return std::array<float, 3>{p[0], -p[1], -p[2]};
                         });
  print_usd_attribute<4>(out, "quatf[] orientations", n, same_rotations, count,
                         [&](std::size_t m, std::size_t i) {
                           const auto& q = moments[m].rotations[i];
                           return std::array<float, 4>{q[0], q[1], -q[2], -q[3]};
                         });
  print_usd_attribute<3>(out, "float3[] scales", n, same_scales, count, [&](std::size_t m, std::size_t i) {
    const auto& s = moments[m].log_scales[i];
    return std::array<float, 3>{std::exp(s[0]), std::exp(s[1]), std::exp(s[2])};
  });
  print_usd_attribute<1>(out, "float[] opacities", n, same_in_all(moments, &ImportedSplats::opacity_logits),
                         count, [&](std::size_t m, std::size_t i) {
                           return std::array<float, 1>{sigmoid_of(moments[m].opacity_logits[i])};
                         });
  out.print("    uniform int radiance:sphericalHarmonicsDegree = {}\n", degree);
  print_usd_attribute<3>(
      out, "float3[] radiance:sphericalHarmonicsCoefficients", n, same_colours,
      [&](std::size_t m) { return moments[m].count() * written; },
      [&](std::size_t m, std::size_t i) {
        const std::size_t coefficient = i % written;
        const float sign = coefficient == 0 ? 1.0f : kHalfTurnSigns[coefficient - 1];
        const float* const c =
            &SplatSeries::sh(moments, m)[(i / written * first.coefficients() + coefficient) * 3];
        return std::array<float, 3>{sign * c[0], sign * c[1], sign * c[2]};
      });
  if (first.offset != std::array<double, 3>{}) {
    out.print("    double3 xformOp:translate = ({}, {}, {})\n", first.offset[0], 0 - first.offset[1],
              0 - first.offset[2]);
    out.put("    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n");
  }
  out.put("}\n");
  out.flush();
  file.commit();
}

}  // namespace

void write_usda(const std::filesystem::path& path, const ImportedSplats& splats) {
  write_usd_moments(path, std::span(&splats, 1));
}

void write_usda_series(const std::filesystem::path& path, const SplatSeries& series) {
  write_usd_moments(path, series.moments());
}

std::vector<std::string> usd_remarks(const ImportedSplats& splats) {
  if (splats.sh_degree <= 3) return {};
  return {fmt::format("spherical harmonics of degree 4 to {} are lost: USD files have at most degree 3",
                      splats.sh_degree)};
}

}  // namespace ubs
