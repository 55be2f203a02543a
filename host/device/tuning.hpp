// SPDX-License-Identifier: Apache-2.0
// Tuned constants are constants of kernels, and choices between implementations in a back end, whose best
// value depends on the device. `ubs-lab tune` finds these values and stores them in a file per device. This
// header declares the entries of the tables that back ends have of their tuned constants, and functions that
// read and write the file. Results depend on the tuned values, as they depend on the build and on the device.
#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

using TuningValues = std::map<std::string, unsigned>;  // values by macro, as in DeviceInfo::tuning

struct TunedConstant {
  std::string_view macro;            // macro of the kernels, or a name for a choice in the back end
  unsigned standard;                 // default value; for OpenCL kernels, that of the #ifndef in the source
  std::vector<unsigned> candidates;  // all other values that are supported
  std::string_view source;           // file that uses it: relative to kernels/, or cuda_backend/..., host/...
  RasterKind raster;                 // kind of rasteriser that uses it
  std::vector<std::string> stages;   // stages of a training step whose time depends on it
};
using TunedTable = std::span<const TunedConstant>;

// TunableDevice is implemented by devices whose back end has tuned constants.
class TunableDevice {
 public:
  virtual ~TunableDevice() = default;
  virtual TunedTable tuned_constants() const = 0;
  // Sets the values for all stages that are created afterwards.
  virtual void set_tuning(TuningValues values) = 0;
};

// These functions return the value of a macro in `values`. If the macro is missing there, the first function
// returns `fallback`, and the second one returns the default of the table, which must contain the macro.
unsigned tuned_value(const TuningValues& values, std::string_view macro, unsigned fallback);
unsigned tuned_value(TunedTable table, const TuningValues& values, std::string_view macro);

// Returns the path of the tuning file of a device. Its folder is $UBS_TUNING_DIR. If this variable is not
// set, it is $XDG_CACHE_HOME/ubs, and if XDG_CACHE_HOME is not set either, it is ~/.cache/ubs. The name of
// the file depends on the device, the driver and the platform. Returns an empty path if HOME is not set
// either.
std::filesystem::path tuning_file(const DeviceInfo& device);
// Returns the values in the tuning file. Returns no values if the file does not exist, or if the environment
// variable UBS_TUNING is "off". If the file is damaged or belongs to another device, it is ignored; values
// that the table does not allow are ignored too. A warning, which is printed once per process, names each
// file and value that is ignored.
TuningValues load_tuning(const DeviceInfo& device, TunedTable table);
// Stores values for one kind of rasteriser in the tuning file. The values for the other kind are not changed.
// The file is replaced atomically, and its folder is created if necessary.
void save_tuning(const DeviceInfo& device, TunedTable table, RasterKind raster, const TuningValues& values);

}  // namespace ubs
