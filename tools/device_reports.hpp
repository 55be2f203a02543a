// SPDX-License-Identifier: Apache-2.0
// The longer answers of `ubs devices`: --check and --doctor. `devices` are names as for --device; empty:
// UBS_DEVICE, else all devices. Both return the exit code.
#pragma once

#include <string>
#include <vector>

#include "tools/common/settings_options.hpp"

namespace ubs::tools {

// Names of the settings that decide the form of the method.
std::vector<std::string_view> form_keys();
// Compares every stage with float64, for the form of `settings` in each of `dims`, and keeps the verdict. 10
// if one device is wrong.
int check_devices(const std::vector<std::string>& devices, const std::vector<int>& dims,
                  const SettingsOptions& settings, bool json);
// A page about this machine with a verdict and what to do.
int diagnose(const std::vector<std::string>& devices, bool json);

}  // namespace ubs::tools
