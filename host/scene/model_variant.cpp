// SPDX-License-Identifier: Apache-2.0
#include "host/scene/model_variant.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {
namespace {

std::vector<std::string_view> split_values(std::string_view values) {
  std::vector<std::string_view> out;
  while (true) {
    const std::size_t bar = values.find('|');
    out.push_back(values.substr(0, bar));
    if (bar == std::string_view::npos) return out;
    values.remove_prefix(bar + 1);
  }
}

std::string known_keys() {
  std::string text;
  for (const VariantSwitch& s : kVariantSwitches) text += (text.empty() ? "" : ", ") + std::string(s.key);
  return text;
}

}  // namespace

int ModelVariant::lobes() const {
  return std::max(0, static_cast<int>(colour) - static_cast<int>(ColourMode::sh3));
}

int ModelVariant::harmonics() const {
  const int bands = lobes() > 0 ? 1 : static_cast<int>(colour);
  return bands * bands;
}

std::array<int, kVariantSwitches.size()> variant_numbers(const ModelVariant& v) {
  return {static_cast<int>(v.rot_mode),     static_cast<int>(v.cov_param), static_cast<int>(v.beta_cond),
          static_cast<int>(v.beta_opacity), static_cast<int>(v.cov_mode),  static_cast<int>(v.kernel),
          static_cast<int>(v.colour),       static_cast<int>(v.antialias), static_cast<int>(v.conditioning)};
}

ModelVariant variant_from_numbers(const std::array<int, kVariantSwitches.size()>& n) {
  return {static_cast<RotMode>(n[0]),     static_cast<CovParam>(n[1]),  static_cast<BetaCond>(n[2]),
          static_cast<BetaOpacity>(n[3]), static_cast<CovMode>(n[4]),   static_cast<SpatialKernel>(n[5]),
          static_cast<ColourMode>(n[6]),  static_cast<Antialias>(n[7]), static_cast<Conditioning>(n[8])};
}

std::vector<std::pair<std::string, std::string>> non_default_switches(const ModelVariant& variant) {
  std::vector<std::pair<std::string, std::string>> out;
  const auto numbers = variant_numbers(variant);
  for (std::size_t i = 0; i < numbers.size(); ++i)
    if (numbers[i] != 0)
      out.emplace_back(kVariantSwitches[i].key,
                       split_values(kVariantSwitches[i].values)[static_cast<std::size_t>(numbers[i])]);
  return out;
}

std::string to_string(const ModelVariant& variant) {
  std::string text;
  for (const auto& [key, value] : non_default_switches(variant))
    text += (text.empty() ? "" : ", ") + key + " " + value;
  return text.empty() ? "default" : text;
}

void set_switch(ModelVariant& variant, std::string_view key, std::string_view value,
                std::string_view origin) {
  auto numbers = variant_numbers(variant);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (key != kVariantSwitches[i].key) continue;
    const auto values = split_values(kVariantSwitches[i].values);
    for (std::size_t k = 0; k < values.size(); ++k)
      if (value == values[k]) {
        numbers[i] = static_cast<int>(k);
        variant = variant_from_numbers(numbers);
        return;
      }
    fail(ErrorKind::data, "{}: '{}' is not a value of {}: expected one of {}", origin, value, key,
         kVariantSwitches[i].values);
  }
  fail(ErrorKind::data,
       "{}: unknown setting '{}' of the variant (known: {}): the file may come from a newer version", origin,
       key, known_keys());
}

void check_variant(int dim, const ModelVariant& v) {
  if (v.rot_mode == RotMode::quaternion && dim != 3)
    fail(ErrorKind::usage, "rot_mode = quaternion needs dim = 3, not {}", dim);
  if (v.rot_mode != RotMode::taylor1 && v.cov_param != CovParam::spatial_ortho)
    fail(ErrorKind::usage, "rot_mode only applies to cov_param = spatial_ortho; the variant is: {}",
         to_string(v));
  if (v.direct() && (v.cov_param == CovParam::skew_nd || v.cov_mode != CovMode::upper))
    fail(ErrorKind::usage,
         "conditioning = direct has no covariance of all dimensions, so it does not support cov_param = "
         "skew_nd or a cov_mode other than upper; the variant is: {}",
         to_string(v));
}

}  // namespace ubs
