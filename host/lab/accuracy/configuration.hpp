// SPDX-License-Identifier: Apache-2.0
// Configuration is a set of settings for training and rendering, with a label. `ubs-lab accuracy` measures
// errors and times with each of them. To measure a new setting, add a line to the table of standard
// configurations (configuration.cpp).
#pragma once

#include <string>
#include <vector>

#include "host/settings/train_settings.hpp"

namespace ubs::accuracy {

struct Configuration {
  std::string label;
  std::vector<std::string> settings;  // each is "key=value", as in the option --set
  // Settings of the variant that the float64 reference computes. If there are none, the reference computes
  // the variant of `settings`.
  std::vector<std::string> truth = {};
};

// Returns the standard configurations. The first one is the default.
const std::vector<Configuration>& standard_configurations();

// Parses "label:key=value,key=value". "label" alone means the default settings. In
// "label:key=value|key=value", the settings after the bar are `truth`. Throws Error(usage).
Configuration parse_configuration(const std::string& text);

// Returns `base` after applying the settings of the configuration. Throws Error(usage) with a message that
// contains the label.
TrainSettings apply(TrainSettings base, const Configuration& configuration);
// These functions return the variant that the float64 reference computes, and its name for tables. The name
// is "same" if it is the variant of the configuration; otherwise it lists the values in `truth`, such as
// "exp".
ModelVariant truth_variant(const TrainSettings& base, const Configuration& configuration);
std::string truth_name(const Configuration& configuration);

}  // namespace ubs::accuracy
