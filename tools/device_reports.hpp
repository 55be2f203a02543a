// SPDX-License-Identifier: Apache-2.0
// check_devices() and diagnose() are the parts of `ubs devices` with long output: --check and --doctor.
// `devices` are names as for --device. If it is empty, UBS_DEVICE is used, or all devices if UBS_DEVICE is
// not set. Both functions return the exit code.
#pragma once

#include <string>
#include <vector>

#include "tools/common/settings_options.hpp"

namespace ubs::tools {

// Returns the names of the settings that determine the variant of the method.
std::vector<std::string_view> form_keys();
// Compares every stage with a float64 reference, for the variant of `settings` in each of `dims`, and stores
// the result. Returns 10 if a device computes wrong results.
int check_devices(const std::vector<std::string>& devices, const std::vector<int>& dims,
                  const SettingsOptions& settings, bool json);
// Prints a page about this machine with a verdict and advice.
int diagnose(const std::vector<std::string>& devices, bool json);

}  // namespace ubs::tools
