// SPDX-License-Identifier: Apache-2.0
#include "host/lab/accuracy/configuration.hpp"

#include "host/base/error.hpp"
#include "host/settings/fields.hpp"

namespace ubs::accuracy {
namespace {

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(separator, at), text.size());
    if (end > at) parts.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return parts;
}

void set_all(TrainSettings& settings, const std::vector<std::string>& assignments, const std::string& label) {
  const auto fields = bind_fields(settings, train_fields());
  for (const std::string& assignment : assignments)
    set_field(fields, assignment, "configuration '" + label + "'");
}

}  // namespace

const std::vector<Configuration>& standard_configurations() {
  static const std::vector<Configuration> all{
      {"default", {}},
      // Arithmetic
      {"native maths", {"math=native"}},
      {"rough maths", {"math=rough"}},
      // The other rasteriser adds values in a different order, which is the only additional error
      {"raster gpu", {"raster=gpu"}},
      // Splats are skipped in pixels in which their alpha is below this value (docs/variants.md)
      {"alpha_min 0.0001", {"alpha_min=0.0001"}},
      {"alpha_min 0.001", {"alpha_min=0.001"}},
      {"alpha_min 1/255", {"alpha_min=0.00392157"}},
      {"native + alpha_min 0.001", {"math=native", "alpha_min=0.001"}},
      // Approximations of the rotation exp A that use the same parameters A. Their results are compared with
      // those of the exact rotation exp A in float64.
      {"rotation exp", {"rot_mode=exp"}, {"rot_mode=exp"}},
      {"rotation taylor1", {"rot_mode=taylor1"}, {"rot_mode=exp"}},
      {"rotation taylor2", {"rot_mode=taylor2"}, {"rot_mode=exp"}},
      {"rotation cayley", {"rot_mode=cayley"}, {"rot_mode=exp"}},
  };
  return all;
}

Configuration parse_configuration(const std::string& text) {
  const std::size_t colon = text.find(':');
  Configuration configuration{text.substr(0, colon), {}};
  if (configuration.label.empty() || configuration.label.find_first_of(",\"\n|") != std::string::npos)
    fail(ErrorKind::usage, "--config '{}': expected label:key=value,key=value", text);
  if (colon == std::string::npos) return configuration;
  const std::string rest = text.substr(colon + 1);
  const std::size_t bar = rest.find('|');
  configuration.settings = split(rest.substr(0, bar), ',');
  if (bar != std::string::npos) configuration.truth = split(rest.substr(bar + 1), ',');
  apply({}, configuration);  // throws now if a key is unknown, before any measurement starts
  return configuration;
}

TrainSettings apply(TrainSettings base, const Configuration& configuration) {
  set_all(base, configuration.settings, configuration.label);
  return base;
}

ModelVariant truth_variant(const TrainSettings& base, const Configuration& configuration) {
  TrainSettings settings = apply(base, configuration);
  set_all(settings, configuration.truth, configuration.label);
  return settings.variant;
}

std::string truth_name(const Configuration& configuration) {
  if (configuration.truth.empty()) return "same";
  std::string name;
  for (const std::string& assignment : configuration.truth) {
    if (!name.empty()) name += ' ';
    name += assignment.substr(assignment.find('=') + 1);
  }
  return name;
}

}  // namespace ubs::accuracy
