// SPDX-License-Identifier: Apache-2.0
#include "host/device/kernel_options.hpp"

#include "host/base/error.hpp"
#include "host/scene/frozen_groups.hpp"
#include "kernels/variant.h"

namespace ubs {
namespace {

Options gradient_options(const KernelConfig& config) {
  const ParameterLayout layout(config.dim, config.variant);
  const SplatGradientNeeds needs = splat_gradient_needs(layout, config.frozen, config.query_grad);
  Options options;
  if (!needs.shape) options.push_back("-DUBS_NO_V_SHAPE=1");
  if (!needs.opacity) options.push_back("-DUBS_NO_V_OPACITY=1");
  if (layout.variant.has_spatial_beta() && !needs.beta) options.push_back("-DUBS_NO_V_BETA=1");
  if (!needs.colour) options.push_back("-DUBS_NO_V_COLOUR=1");
  return options;
}

// Returns the options for a user-defined falloff.
Options own_falloff_options(const KernelConfig& config) {
  if (!config.falloff) return {};
  const OwnFalloff& own = *config.falloff;
  // A hexadecimal number represents the float exactly.
  return {fmt::format("-DUBS_FALLOFF={}", UBS_FALLOFF_OWN), "-DUBS_OWN_LOG2=" + own.log2,
          "-DUBS_OWN_R_SLOPE=" + own.r_slope, "-DUBS_OWN_BETA_SLOPE=" + own.beta_slope,
          fmt::format("-DUBS_OWN_SUPPORT={:a}f", own.support)};
}

}  // namespace

void append(Options& options, const Options& more) {
  options.insert(options.end(), more.begin(), more.end());
}

Options variant_options(const KernelConfig& config) {
  ModelVariant variant = config.variant;
  if (config.falloff) variant.kernel = {};  // own_falloff_options() replaces it
  Options options = variant_options(variant);
  append(options, own_falloff_options(config));
  return options;
}

Options variant_options(const ModelVariant& variant) {
  Options options;
  const auto numbers = variant_numbers(variant);
  for (std::size_t i = 0; i < numbers.size(); ++i)
    if (numbers[i] != 0) options.push_back(fmt::format("-D{}={}", kVariantSwitches[i].macro, numbers[i]));
  return options;
}

Options falloff_options(const KernelConfig& config) {
  if (config.falloff) return own_falloff_options(config);
  if (config.variant.kernel == SpatialKernel{}) return {};
  return {fmt::format("-DUBS_FALLOFF={}", static_cast<int>(config.variant.kernel))};
}

Options extent_options(const KernelConfig& config) {
  Options options;
  // A hexadecimal number represents the float exactly, so it does not depend on how the compiler rounds
  // decimals.
  if (config.alpha_min > 0) options.push_back(fmt::format("-DUBS_ALPHA_MIN={:a}f", config.alpha_min));
  if (!config.backward) options.push_back("-DUBS_FORWARD_ONLY=1");
  return options;
}

Options frozen_options(const KernelConfig& config) {
  if (config.frozen == 0) return {};
  return {fmt::format("-DUBS_FROZEN={}", config.frozen)};
}

Options depth_gradient_options(const KernelConfig& config) {
  if (!config.depth_grad) return {};
  return {"-DUBS_DEPTH_GRAD=1"};
}

Options array_options(const KernelConfig& config) {
  if (!config.gaussian_arrays) return {};
  return {"-DUBS_GAUSSIAN_ARRAYS=1"};
}

Options arithmetic_options(MathMode math) {
  if (math == MathMode::exact) return {};
  return {fmt::format("-DUBS_MATH={}", static_cast<int>(math))};
}

Options raster_options(const KernelConfig& config) {
  Options options;
  if (config.depth) options.push_back("-DUBS_DEPTH=1");
  if (config.absgrad) options.push_back("-DUBS_ABSGRAD=1");
  append(options, falloff_options(config));
  append(options, extent_options(config));
  append(options, gradient_options(config));
  append(options, arithmetic_options(config.math));
  return options;
}

}  // namespace ubs
