// SPDX-License-Identifier: Apache-2.0
// examine() compares the result of a device for a case with the float64 oracle (host/lab/oracle/study.hpp).
// It checks the properties that must hold for every case, and measures the errors and the allowed errors.
#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "host/lab/oracle/study.hpp"
#include "tests/stress/device_runner.hpp"

namespace ubs::stress {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The promised relative error (2-norm) of an image, and of a gradient by parameter group. It holds unless the
// rounding of the inputs alone causes a larger error.
inline constexpr double kPromise = 1e-3;
// An error above this multiple of the change that half-ulp rounding of the inputs causes is an error of the
// program itself.
inline constexpr double kConditioning = 32;

// float64: the errors are within the promise. inputs: they are larger, but rounding of the inputs explains
// them. known: a stated limit of the formulas explains them (known_limits.hpp). undecided: rounding decides
// nearly everywhere, or the numbers exceed single precision, so only the properties of every case were
// checked. failed: everything else.
enum class Outcome { float64, inputs, known, undecided, failed };
inline constexpr std::size_t kOutcomes = 5;
std::string_view to_string(Outcome outcome);

// The kind of error of a failed case.
enum class Fault {
  none,
  refused,
  image_not_finite,
  outside_colours,
  gradient_not_finite,
  culled_gradient,
  image,
  gradient
};

struct Verdict {
  Outcome outcome = Outcome::float64;
  Fault fault = Fault::none;
  std::string limit;                           // if `known`: name of the limit
  double rounding = 0;                         // if `known`: half an ulp times the amplification of the limit
  std::string problem;                         // if `failed`: description of the error
  double value_error = 0, gradient_error = 0;  // relative 2-norms over the decided pixels
  double value_floor = 0, gradient_floor = 0;  // errors that half-ulp rounding of the inputs causes
  std::string worst_group;
  std::size_t drawn = 0, pixels = 0, undecided = 0;
};

// Expectation is the part of the work that needs no device. Cases may be prepared in parallel.
struct Expectation {
  std::vector<float> all_weights;  // used for checking properties
  std::vector<float> weights;      // 0 at undecided pixels; used for comparing
  oracle::Study study;
};
Expectation expect(const Case& c);

// Does the part of the work that needs the device. If the device refuses the case or fails, the verdict is
// `failed`.
Verdict answer(const Case& c, const Expectation& expected, DeviceRunner& runner);
inline Verdict examine(const Case& c, DeviceRunner& runner) { return answer(c, expect(c), runner); }

}  // namespace ubs::stress
