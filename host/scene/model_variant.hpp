// SPDX-License-Identifier: Apache-2.0
// ModelVariant describes the variant of the method that a model was trained with (method.md 8,
// docs/variants.md). The variant determines the meaning of the parameters and how the model is rendered. It
// consists of several switches, each of which is an enumeration. The value 0 of each enumeration is the
// published one, and the numbers are the same as in kernels/variant.h. Model files contain a comment line
// `ubs <key> <value>` for each switch that is not at its default.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/scene/spatial_kernel.hpp"

namespace ubs {

enum class RotMode { taylor1, taylor2, cayley, exp, quaternion };
enum class CovParam { spatial_ortho, cholesky, skew_nd };
enum class BetaCond { on, off };
enum class BetaOpacity { tanh, none, gaussian };
enum class CovMode { upper, whiten };
enum class ColourMode { rgb, sh0, sh1, sh2, sh3, sb1, sb2, sb3 };
enum class Antialias { off, on };
enum class Conditioning { covariance, direct };

struct ModelVariant {
  RotMode rot_mode{};
  CovParam cov_param{};
  BetaCond beta_cond{};
  BetaOpacity beta_opacity{};
  CovMode cov_mode{};
  SpatialKernel kernel{};
  ColourMode colour{};
  Antialias antialias{};
  Conditioning conditioning{};

  bool operator==(const ModelVariant&) const = default;

  int lobes() const;      // number of spherical Beta lobes in addition to the constant term
  int harmonics() const;  // number of coefficients per colour channel; 0 for rgb
  bool has_spatial_beta() const { return row_of(kernel).has_beta; }
  bool has_query_beta() const { return beta_cond == BetaCond::on || beta_opacity == BetaOpacity::tanh; }
  bool direct() const { return conditioning == Conditioning::direct; }
  // Returns whether the conditioning weights of direct conditioning are separate parameters. If so, they are
  // stored in the rows of the query betas.
  bool learnt_weights() const {
    return direct() && beta_opacity != BetaOpacity::tanh && beta_cond == BetaCond::on;
  }
};

// VariantSwitch describes one switch. `values` contains its allowed values in the order of the enumeration,
// separated by |.
struct VariantSwitch {
  const char* key;    // key in settings and files
  const char* macro;  // macro in kernels/variant.h
  const char* values;
};
inline constexpr std::array<VariantSwitch, 9> kVariantSwitches{{
    {"rot_mode", "UBS_ROT_MODE", "taylor1|taylor2|cayley|exp|quaternion"},
    {"cov_param", "UBS_COV_PARAM", "spatial_ortho|cholesky|skew_nd"},
    {"beta_cond", "UBS_BETA_COND", "on|off"},
    {"beta_opacity", "UBS_BETA_OPACITY", "tanh|none|gaussian"},
    {"cov_mode", "UBS_COV_MODE", "upper|whiten"},
    {"kernel", "UBS_FALLOFF", kSpatialKernelNames.data()},
    {"colour", "UBS_COLOUR", "rgb|sh0|sh1|sh2|sh3|sb1|sb2|sb3"},
    {"antialias", "UBS_ANTIALIAS", "off|on"},
    {"conditioning", "UBS_DIRECT", "covariance|direct"},
}};
// Returns the allowed values of the switch `key`, or null if there is no such switch.
constexpr const char* variant_values(std::string_view key) {
  for (const VariantSwitch& s : kVariantSwitches)
    if (key == s.key) return s.values;
  return nullptr;
}

// These functions convert a variant to and from the numbers of its values, in the order of kVariantSwitches.
std::array<int, kVariantSwitches.size()> variant_numbers(const ModelVariant& variant);
ModelVariant variant_from_numbers(const std::array<int, kVariantSwitches.size()>& numbers);

// Returns key and value of every switch that is not at its default.
std::vector<std::pair<std::string, std::string>> non_default_switches(const ModelVariant& variant);
// Returns, for example, "default" or "kernel gaussian, colour sh3".
std::string to_string(const ModelVariant& variant);
// Sets a switch. Throws Error(data) with a message that starts with `origin` if the key or the value is
// unknown.
void set_switch(ModelVariant& variant, std::string_view key, std::string_view value, std::string_view origin);

// Throws Error(usage) if the switches are incompatible with each other or with N.
void check_variant(int dim, const ModelVariant& variant);

}  // namespace ubs
