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
// An error counts as an error of ubs if it is larger than this multiple of the change that rounding the
// inputs by half an ulp causes.
inline constexpr double kConditioning = 32;

// float64: the errors are at most kPromise. inputs: the errors are larger, but at most kConditioning times
// the change that rounding of the inputs causes. known: the errors are larger, but within a known limit of
// the formulas (known_limits.hpp). undecided: nearly all pixels are undecided, or values exceed the range of
// single precision, so only the properties that hold for every case were checked. failed: a property does not
// hold, or the errors are larger than all of these allow.
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

// Expectation contains the results of a case that are computed without the device. expect() may be called in
// parallel for several cases.
struct Expectation {
  std::vector<float> all_weights;  // used for checking properties
  std::vector<float> weights;      // 0 at undecided pixels; used for comparing
  oracle::Study study;
};
Expectation expect(const Case& c);

// Runs the case on the device and compares the results. If the device rejects the case or an error occurs,
// the outcome is `failed`.
Verdict answer(const Case& c, const Expectation& expected, DeviceRunner& runner);
inline Verdict examine(const Case& c, DeviceRunner& runner) { return answer(c, expect(c), runner); }

}  // namespace ubs::stress
