// SPDX-License-Identifier: Apache-2.0
// This header declares the tuned constants of the OpenCL kernels (host/device/tuning.hpp). A value is passed
// to the kernels as -DMACRO=VALUE. If a constant has no value, the default in its source applies (#ifndef).
#pragma once

#include "host/device/tuning.hpp"

namespace ubs::opencl {

const std::vector<TunedConstant>& tuned_constants();
// Returns the value of a macro in `values`, or its default in the table if `values` does not contain it. The
// overloads in host/device/tuning.hpp also take the default or the table as an argument.
unsigned tuned_value(const TuningValues& values, std::string_view macro);
using ubs::tuned_value;
// Appends a -D option for each constant of `sources` that has a value in `values`. Constants that `options`
// already defines are skipped.
void add_tuning(const TuningValues& values, const std::vector<std::string>& sources,
                std::vector<std::string>& options);

}  // namespace ubs::opencl
