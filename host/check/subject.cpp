// SPDX-License-Identifier: Apache-2.0
#include "host/check/subject.hpp"

#include <fmt/format.h>

namespace ubs::check {

std::string to_string(Part part) {
  switch (part) {
    case Part::drawing:
      return "drawing";
    case Part::loss:
      return "loss";
    case Part::gradients:
      return "gradients";
    case Part::learning:
      return "learning";
    case Part::networks:
      return "networks";
  }
  return "";
}

Form form_of(const KernelConfig& config) { return {config.dim, config.variant, config.query_grad}; }

KernelConfig checked_config(KernelConfig config) {
  const Form& form = forms()[nearest_form(form_of(config))];
  config.variant = form.variant;
  config.query_grad = form.query_grad;
  config.alpha_min = 0;
  config.math = {};
  config.frozen = 0;
  config.depth = false;
  return config;
}

std::string form_text(const KernelConfig& c) {
  std::string text = fmt::format("N = {}, {}", c.dim, c.raster == RasterKind::cpu ? "vectors" : "work-items");
  for (const auto& [key, value] : non_default_switches(c.variant)) text += fmt::format(", {} {}", key, value);
  if (c.query_grad) text += ", query_grad";
  if (!c.backward) text += ", forward only";
  return text;
}

}  // namespace ubs::check
