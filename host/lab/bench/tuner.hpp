// SPDX-License-Identifier: Apache-2.0
// Finds values of tuned constants (host/device/tuning.hpp) by timing the stages concerned. One constant after
// the other, each with the values found so far. A value replaces another only when it is faster by more than
// the noise, twice, and leaves the results of a step as they are, up to rounding.
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
  double before_ms = 0, ms = 0;       // medians of the time of its stages: with the value before, with it
  double ratio = 0, uncertainty = 0;  // median of the ratios of both, taken in turn; its standard error
  double difference = 0;              // of the step's results, relative; 0: the same bits
  bool kept = false;
  bool skipped = false;  // for lack of time
  std::string note;      // why there is no time
};

struct TuneOptions {
  RasterKind raster = RasterKind::cpu;
  bool quick = false;  // few repetitions
  double max_seconds =
      std::numeric_limits<double>::infinity();  // candidates that would begin later are left out
  std::function<void(const Trial&)> on_trial;
};

// A ratio below 1 by more than two per cent and three standard errors.
bool clearly_faster(const Trial& trial);
// The largest |a - b| / |b| of all parts (Euclidean norms), infinite when they do not compare.
using Parts = std::vector<std::vector<float>>;
double relative_difference(const Parts& a, const Parts& b);

// A training step with given values of the constants: that of a device (tune_subject.hpp), or of a test.
class TuneSubject {
 public:
  virtual ~TuneSubject() = default;
  virtual Parts outputs() = 0;
  // Wall time a call of some calls of a stage of TunedConstant::stages.
  virtual double time_ms(const std::string& stage, int calls) = 0;
};
// Throws Error(build, device or memory) where a device does not take the values. Subjects of earlier values
// are still used.
using MakeSubject = std::function<std::unique_ptr<TuneSubject>(const TuningValues&)>;

// The values that differ from the defaults.
TuningValues choose_values(TunedTable table, const MakeSubject& make, const TuneOptions& options);

}  // namespace ubs::bench
