// SPDX-License-Identifier: Apache-2.0
// Tuned constants: constants of kernels and structures of a back end whose best value depends on the device.
// This header declares the entries of the tables of the back ends, and the functions for the file, one per
// device, that stores the values found by `ubs-lab tune`. Results depend on build, device and tuning.
#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

using TuningValues = std::map<std::string, unsigned>;  // by macro, as in DeviceInfo::tuning

struct TunedConstant {
  std::string_view macro;            // or the name of a structure
  unsigned standard;                 // for OpenCL kernels the #ifndef default in the source
  std::vector<unsigned> candidates;  // the only other values that the kernels support
  std::string_view source;           // file that uses it: relative to kernels/, or cuda_backend/..., host/...
  RasterKind raster;                 // the kernels that use it
  std::vector<std::string> stages;   // stages of a training step whose time it changes
};
using TunedTable = std::span<const TunedConstant>;

// A device whose back end has tuned constants.
class TunableDevice {
 public:
  virtual ~TunableDevice() = default;
  virtual TunedTable tuned_constants() const = 0;
  // Applies to stages that are created afterwards.
  virtual void set_tuning(TuningValues values) = 0;
};

// These functions return the value of a macro in `values`. If the macro is missing there, the first function
// returns `fallback`, and the second one returns the default of the table, which must contain the macro.
unsigned tuned_value(const TuningValues& values, std::string_view macro, unsigned fallback);
unsigned tuned_value(TunedTable table, const TuningValues& values, std::string_view macro);

// Returns the path of the file in $UBS_TUNING_DIR, or $XDG_CACHE_HOME/ubs, or ~/.cache/ubs. Its name depends
// on device, driver and platform. Returns an empty path if none of these folders is known.
std::filesystem::path tuning_file(const DeviceInfo& device);
// Returns the values in the file; none if there is no file, or with UBS_TUNING=off. Ignores a file that is
// damaged or of another device, and values that are not in the table. Prints one warning for each of these
// per process.
TuningValues load_tuning(const DeviceInfo& device, TunedTable table);
// Replaces the file's values for `raster` and keeps those for the other kind. The file is replaced
// atomically, and its folder is created if necessary.
void save_tuning(const DeviceInfo& device, TunedTable table, RasterKind raster, const TuningValues& values);

}  // namespace ubs
