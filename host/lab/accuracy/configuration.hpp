// SPDX-License-Identifier: Apache-2.0
// What is compared: settings of training and rendering under a label. The table of standard configurations is
// the one place to enter a new switch: one line.
#pragma once

#include <string>
#include <vector>

#include "host/scene/train_settings.hpp"

namespace ubs::accuracy {

struct Configuration {
  std::string label;
  std::vector<std::string> settings;  // "key=value", as --set takes them
  // The form of the method that is the truth; empty: that of the settings.
  std::vector<std::string> truth = {};
};

// The first one is the default.
const std::vector<Configuration>& standard_configurations();

// "label:key=value,key=value"; "label" alone has the default settings; "label:key=value|key=value" with what
// the truth is behind the bar. Throws Error(usage).
Configuration parse_configuration(const std::string& text);

// `base` with the configuration's settings. Throws Error(usage) naming the label.
TrainSettings apply(TrainSettings base, const Configuration& configuration);
// The form of the method of the truth, and as a word for tables: "same" or "exp".
ModelVariant truth_variant(const TrainSettings& base, const Configuration& configuration);
std::string truth_name(const Configuration& configuration);

}  // namespace ubs::accuracy
