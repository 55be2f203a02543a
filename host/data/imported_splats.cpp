// SPDX-License-Identifier: Apache-2.0
// See imported_splats.hpp.
#include "host/data/imported_splats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

namespace ubs {
namespace {

constexpr float kMaxLogScale = 40;  // e^40 = 2e17; its square still fits float32

template <typename Array>
bool finite(const Array& values) {
  return std::ranges::all_of(values, [](float v) { return std::isfinite(v); });
}

// Why the splat cannot be shown; null when it can.
const char* fault(const ImportedSplats& s, std::size_t i) {
  if (!finite(s.positions[i])) return "position not finite";
  if (!std::ranges::all_of(s.log_scales[i], [](float v) { return std::abs(v) < kMaxLogScale; }))
    return "scale not finite or absurd";
  float norm = 0;
  for (const float q : s.rotations[i]) norm += q * q;
  if (!(norm > 1e-20f) || !std::isfinite(norm)) return "rotation is no quaternion";
  if (std::isnan(s.opacity_logits[i])) return "opacity not finite";
  const auto tame = [i](const std::vector<float>& all, std::size_t n) {
    return std::ranges::all_of(std::span(all).subspan(i * n, n), [](float v) { return std::abs(v) < 1e6f; });
  };
  if (!tame(s.sh, 3 * s.coefficients()) || !tame(s.sb, s.lobe_values())) return "colour not finite or absurd";
  if (!s.betas.empty() && !(std::abs(s.betas[i]) < 20)) return "beta not finite or absurd";
  return nullptr;
}

}  // namespace

void ImportedSplats::resize(std::size_t count) {
  positions.resize(count);
  log_scales.resize(count);
  rotations.resize(count);
  opacity_logits.resize(count);
  sh.resize(count * 3 * coefficients());
  sb.resize(count * lobe_values());
  betas.resize(kernel == SpatialKernel::beta ? count : 0);
}

void append(ImportedSplats& splats, const ImportedSplats& more) {
  const auto join = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  join(splats.positions, more.positions);
  join(splats.log_scales, more.log_scales);
  join(splats.rotations, more.rotations);
  join(splats.opacity_logits, more.opacity_logits);
  join(splats.sh, more.sh);
  join(splats.sb, more.sb);
  join(splats.betas, more.betas);
  for (const LoadReport::Skipped& skipped : more.report.skipped) splats.report.add(skipped);
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
    s.log_scales[kept] = s.log_scales[i];
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
