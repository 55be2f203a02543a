// SPDX-License-Identifier: Apache-2.0
// See imported_splats.hpp.
#include "host/formats/imported_splats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

namespace ubs {
namespace {

constexpr float kMaxLogScale = 40;  // e^40 is 2e17, and its square can still be represented in float32
// If the splats are farther from the origin than this multiple of their extent, rounding positions to float32
// becomes visible. load_dataset.cpp has the same limit for data folders.
constexpr double kFarSplats = 256;

template <typename Array>
bool finite(const Array& values) {
  return std::ranges::all_of(values, [](float v) { return std::isfinite(v); });
}

// Returns the reason why the splat cannot be rendered, or null if it can be rendered.
const char* fault(const ImportedSplats& s, std::size_t i) {
  if (!finite(s.positions[i])) return "the position is not finite";
  if (!std::ranges::all_of(s.log_scales[i], [](float v) { return v < kMaxLogScale; }))  // also false for NaN
    return "a scale is not finite or out of range";
  float norm = 0;
  for (const float q : s.rotations[i]) norm += q * q;
  if (!(norm > 1e-20f) || !std::isfinite(norm)) return "the rotation is not a quaternion";
  if (std::isnan(s.opacity_logits[i])) return "the opacity is not a number";
  const auto tame = [i](const std::vector<float>& all, std::size_t n) {
    return std::ranges::all_of(std::span(all).subspan(i * n, n), [](float v) { return std::abs(v) < 1e6f; });
  };
  if (!tame(s.sh, 3 * s.coefficients()) || !tame(s.sb, s.lobe_values()))
    return "a colour is not finite or out of range";
  if (!s.betas.empty() && !(std::abs(s.betas[i]) < 20)) return "beta is not finite or out of range";
  return nullptr;
}

// Raises the degree of the spherical harmonics by adding coefficients that are 0.
void raise_degree(ImportedSplats& s, int degree) {
  const std::vector<float> old = std::move(s.sh);
  const std::size_t before = 3 * s.coefficients();
  s.sh_degree = degree;
  s.sh.assign(s.count() * 3 * s.coefficients(), 0.0f);
  for (std::size_t i = 0; i < s.count(); ++i)
    std::ranges::copy(std::span(old).subspan(i * before, before), &s.sh[i * 3 * s.coefficients()]);
}

// Returns the median of the coordinates, in whole numbers, if the splats are so far from the origin that
// rounding their positions to float32 would be visible. Medians are used, because a few distant splats, such
// as those of a sky, hardly change them.
std::optional<std::array<double, 3>> far_origin(const Coordinates& coordinates) {
  std::array<double, 3> centre{};
  double distance = 0, size = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto median = [](std::vector<double> values) {
      std::erase_if(values, [](double v) { return !std::isfinite(v); });
      if (values.empty()) return 0.0;
      const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
      std::ranges::nth_element(values, middle);
      return *middle;
    };
    centre[k] = median(coordinates[k]);
    std::vector<double> deviations = coordinates[k];
    for (double& v : deviations) v = std::abs(v - centre[k]);
    size = std::max(size, median(std::move(deviations)));
    distance = std::hypot(distance, centre[k]);
  }
  if (distance <= kFarSplats * size || distance >= 1e15) return {};
  for (double& v : centre) v = std::round(v);
  return centre;
}

}  // namespace

void ImportedSplats::resize(std::size_t count) {
  positions.resize(count);
  log_scales.resize(count);
  rotations.resize(count);
  opacity_logits.resize(count);
  sh.resize(count * 3 * coefficients());
  sb.resize(count * lobe_values());
  betas.resize(row_of(kernel).has_beta ? count : 0);
}

void append(ImportedSplats& splats, const ImportedSplats& more) {
  if (splats.sh_degree < more.sh_degree) raise_degree(splats, more.sh_degree);
  if (more.sh_degree < splats.sh_degree) {
    ImportedSplats raised = more;
    raise_degree(raised, splats.sh_degree);
    return append(splats, raised);
  }
  const auto join = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  const std::size_t before = splats.count();
  join(splats.positions, more.positions);
  if (more.offset != splats.offset)
    for (auto& p : std::span(splats.positions).subspan(before))
      for (std::size_t k = 0; k < 3; ++k)
        p[k] = static_cast<float>(p[k] + (more.offset[k] - splats.offset[k]));
  join(splats.log_scales, more.log_scales);
  join(splats.rotations, more.rotations);
  join(splats.opacity_logits, more.opacity_logits);
  join(splats.sh, more.sh);
  join(splats.sb, more.sb);
  join(splats.betas, more.betas);
  for (const LoadReport::Skipped& skipped : more.report.skipped) splats.report.add(skipped);
  for (const std::string& note : more.report.notes) splats.report.note(note);
}

ImportedSplats part_of(const ImportedSplats& splats, std::size_t first, std::size_t count) {
  ImportedSplats part;
  part.kernel = splats.kernel;
  part.sh_degree = splats.sh_degree;
  part.lobes = splats.lobes;
  part.antialiased = splats.antialiased;
  part.offset = splats.offset;
  part.report = splats.report;
  const auto cut = [first, count](auto& to, const auto& from, std::size_t n) {
    const auto begin = from.begin() + static_cast<std::ptrdiff_t>(first * n);
    to.assign(begin, begin + static_cast<std::ptrdiff_t>(count * n));
  };
  cut(part.positions, splats.positions, 1);
  cut(part.log_scales, splats.log_scales, 1);
  cut(part.rotations, splats.rotations, 1);
  cut(part.opacity_logits, splats.opacity_logits, 1);
  cut(part.sh, splats.sh, 3 * splats.coefficients());
  cut(part.sb, splats.sb, splats.lobe_values());
  if (!splats.betas.empty()) cut(part.betas, splats.betas, 1);
  return part;
}

void place(ImportedSplats& splats, const Coordinates& coordinates) {
  const std::optional<std::array<double, 3>> origin = far_origin(coordinates);
  for (std::size_t k = 0; k < 3; ++k) {
    if (origin) splats.offset[k] += (*origin)[k];
    for (std::size_t i = 0; i < splats.count(); ++i)
      splats.positions[i][k] = static_cast<float>(coordinates[k][i] - (origin ? (*origin)[k] : 0));
  }
  if (origin)
    splats.report.note(
        fmt::format("splats far from the origin: coordinates are relative to ({:.0f}, {:.0f}, {:.0f})",
                    splats.offset[0], splats.offset[1], splats.offset[2]));
}

void apply_offset(ImportedSplats& splats) {
  if (splats.offset == std::array<double, 3>{}) return;
  Coordinates coordinates;
  for (std::size_t k = 0; k < 3; ++k)
    for (const auto& position : splats.positions) coordinates[k].push_back(position[k] + splats.offset[k]);
  if (far_origin(coordinates)) return;
  splats.offset = {};
  place(splats, coordinates);
}

void clean(ImportedSplats& s) {
  std::size_t kept = 0;
  const auto move = [&kept](std::vector<float>& all, std::size_t n, std::size_t i) {
    std::ranges::copy(std::span(all).subspan(i * n, n), all.begin() + static_cast<std::ptrdiff_t>(kept * n));
  };
  for (std::size_t i = 0; i < s.count(); ++i) {
    if (const char* why = fault(s, i)) {
      s.report.skip(fmt::format("splat {}", i), why);
      continue;
    }
    s.positions[kept] = s.positions[i];
    for (std::size_t k = 0; k < 3; ++k) s.log_scales[kept][k] = std::max(s.log_scales[i][k], kFlatLogScale);
    float norm = 0;
    for (const float q : s.rotations[i]) norm += q * q;
    for (std::size_t k = 0; k < 4; ++k) s.rotations[kept][k] = s.rotations[i][k] / std::sqrt(norm);
    s.opacity_logits[kept] = std::clamp(s.opacity_logits[i], -kMaxLogit, kMaxLogit);
    move(s.sh, 3 * s.coefficients(), i);
    move(s.sb, s.lobe_values(), i);
    if (!s.betas.empty()) s.betas[kept] = s.betas[i];
    ++kept;
  }
  s.resize(kept);
}

}  // namespace ubs
