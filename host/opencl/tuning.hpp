// SPDX-License-Identifier: Apache-2.0
// Constants of the kernels whose best value depends on the device: the one table of them, and the file a
// device that remembers what `ubs tune` found there. A value is passed to the kernels as -DMACRO=VALUE;
// without one the #ifndef default in the source holds. Results depend on build, device and tuning.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs::opencl {

using TuningValues = std::map<std::string, unsigned>;  // by macro; as DeviceInfo::tuning

struct TunedConstant {
  std::string_view macro;
  unsigned standard;                 // the #ifndef default in the source
  std::vector<unsigned> candidates;  // the only other values that the kernels are written for
  std::string_view source;           // below kernels/
  RasterKind raster;                 // the kernels that read it
  std::vector<std::string> stages;   // of a training step: those whose time it changes
};
const std::vector<TunedConstant>& tuned_constants();
// The value given for a macro of the table, else `fallback`, else its default.
unsigned tuned_value(const TuningValues& values, std::string_view macro);
unsigned tuned_value(const TuningValues& values, std::string_view macro, unsigned fallback);
// Appends -D options for the values of constants of these sources that the options do not define already.
void add_tuning(const TuningValues& values, const std::vector<std::string>& sources,
                std::vector<std::string>& options);

// In $UBS_TUNING_DIR, else $XDG_CACHE_HOME/ubs, else ~/.cache/ubs; named by device, driver and platform.
// Empty when there is no such folder to name.
std::filesystem::path tuning_file(const DeviceInfo& device);
// What the file says, nothing without one or with UBS_TUNING=off. A file that is damaged or of another device
// is ignored, values that the table does not know too; each with one warning line on stderr a process.
TuningValues load_tuning(const DeviceInfo& device);
// Replaces the file's values for `raster`, keeps those for the other one, atomically. Makes the folder.
void save_tuning(const DeviceInfo& device, RasterKind raster, const TuningValues& values);

}  // namespace ubs::opencl
