// SPDX-License-Identifier: Apache-2.0
// The tuned constants of the OpenCL kernels (host/device/tuning.hpp). A value is passed to the kernels as
// -DMACRO=VALUE; without one the #ifndef default in the source holds.
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::opencl {

const std::vector<TunedConstant>& tuned_constants();
// The value given for a macro of the table, else its default; with a third argument, else that.
unsigned tuned_value(const TuningValues& values, std::string_view macro);
using ubs::tuned_value;
// Appends -D options for the values of constants of these sources that the options do not define already.
void add_tuning(const TuningValues& values, const std::vector<std::string>& sources,
                std::vector<std::string>& options);

}  // namespace ubs::opencl
