// SPDX-License-Identifier: Apache-2.0
// choose_values() finds values of tuned constants (host/device/tuning.hpp). For each constant, it times the
// stages that this constant affects. It optimises one constant after the other, each with the values found so
// far. A value replaces the current one only if two measurements show that it is faster by more than the
// noise, and if the results of a training step are equal up to rounding.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "host/device/tuning.hpp"

namespace ubs::bench {

struct Trial {
  std::string macro;
  unsigned value = 0;
  // Median times of the stages that the constant affects, with the previous value and with this value [ms].
  double before_ms = 0, ms = 0;
  // Median of the ratios of alternating measurements (this value / previous value), and its standard error.
  double ratio = 0, uncertainty = 0;
  double difference = 0;  // relative difference of the results of a step; 0: bit-identical
  bool kept = false;
  bool skipped = false;  // not tried, because the time limit was reached
  std::string note;      // reason why the time was not measured
};

struct TuneOptions {
  RasterKind raster = RasterKind::cpu;
  bool quick = false;  // few repetitions
  double max_seconds =
      std::numeric_limits<double>::infinity();  // candidates that would start later are skipped
  std::function<void(const Trial&)> on_trial;
};

// Returns whether the ratio is below 1 by more than two per cent and by more than three standard errors.
bool clearly_faster(const Trial& trial);
// Parts contains the results of a training step: one array for the image, and one for the gradient of each
// parameter row.
using Parts = std::vector<std::vector<float>>;
// Returns the largest |a - b| / |b| of all parts (Euclidean norms), or infinity if the parts have different
// sizes.
double relative_difference(const Parts& a, const Parts& b);

// TuneSubject is a training step with given values of the constants, on a device (tune_subject.hpp) or in a
// test.
class TuneSubject {
 public:
  virtual ~TuneSubject() = default;
  virtual Parts outputs() = 0;
  // Runs a stage of TunedConstant::stages `calls` times and returns the wall time per call.
  virtual double time_ms(const std::string& stage, int calls) = 0;
};
// MakeSubject is a function that creates a subject with the given values. It throws Error(build),
// Error(device) or Error(memory) if the device does not support them. Subjects that were created earlier
// remain in use.
using MakeSubject = std::function<std::unique_ptr<TuneSubject>(const TuningValues&)>;

// Tunes the constants of the table for the rasteriser `options.raster`, one after the other. Returns the
// values that differ from the defaults.
TuningValues choose_values(TunedTable table, const MakeSubject& make, const TuneOptions& options);

}  // namespace ubs::bench
