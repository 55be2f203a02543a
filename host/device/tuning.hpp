// SPDX-License-Identifier: Apache-2.0
// Constants of kernels and structures of a back end whose best value depends on the device: what the tables
// of the back ends say about them, and the file a device that remembers what `ubs-lab tune` found there. Results
// depend on build, device and tuning.
#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/device/stages.hpp"

namespace ubs {

using TuningValues = std::map<std::string, unsigned>;  // by macro; as DeviceInfo::tuning

struct TunedConstant {
  std::string_view macro;            // or the name of a structure
  unsigned standard;                 // of OpenCL kernels the #ifndef default in the source
  std::vector<unsigned> candidates;  // the only other values that the kernels are written for
  std::string_view source;           // below kernels/, or cuda_backend/..., host/...: what reads it
  RasterKind raster;                 // the kernels that read it
  std::vector<std::string> stages;   // of a training step: those whose time it changes
};
using TunedTable = std::span<const TunedConstant>;

// A device whose back end has tuned constants.
class TunableDevice {
 public:
  virtual ~TunableDevice() = default;
  virtual TunedTable tuned_constants() const = 0;
  // For stages made from now on.
  virtual void set_tuning(TuningValues values) = 0;
};

// The value given for a macro, else `fallback`; or else its default in the table, where it must be.
unsigned tuned_value(const TuningValues& values, std::string_view macro, unsigned fallback);
unsigned tuned_value(TunedTable table, const TuningValues& values, std::string_view macro);

// In $UBS_TUNING_DIR, else $XDG_CACHE_HOME/ubs, else ~/.cache/ubs; named by device, driver and platform.
// Empty when there is no such folder to name.
std::filesystem::path tuning_file(const DeviceInfo& device);
// What the file says, nothing without one or with UBS_TUNING=off. A file that is damaged or of another device
// is ignored, values that the table does not know too; each with one warning line on stderr a process.
TuningValues load_tuning(const DeviceInfo& device, TunedTable table);
// Replaces the file's values for `raster`, keeps those for the other one, atomically. Makes the folder.
void save_tuning(const DeviceInfo& device, TunedTable table, RasterKind raster, const TuningValues& values);

}  // namespace ubs
