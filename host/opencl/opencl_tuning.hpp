// SPDX-License-Identifier: Apache-2.0
// The tuned constants of the OpenCL kernels (host/device/tuning.hpp). A value is passed to the kernels as
// -DMACRO=VALUE. Without a value, the #ifndef default in the source applies.
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::opencl {

const std::vector<TunedConstant>& tuned_constants();
// Returns the value of a macro in `values`. If there is none, returns `fallback` if it is given, and
// otherwise the default of the table.
unsigned tuned_value(const TuningValues& values, std::string_view macro);
using ubs::tuned_value;
// Appends -D options for the constants of these sources that have a value and are not yet defined by the
// options.
void add_tuning(const TuningValues& values, const std::vector<std::string>& sources,
                std::vector<std::string>& options);

}  // namespace ubs::opencl
