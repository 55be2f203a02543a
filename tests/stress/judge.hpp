// SPDX-License-Identifier: Apache-2.0
// A device's answer to a case against the float64 oracle (host/lab/oracle/study.hpp): what must hold for
// every case, how large the errors are, and what they are allowed to be.
#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "host/lab/oracle/study.hpp"
#include "tests/stress/device_runner.hpp"

namespace ubs::stress {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Relative 2-norm error of an image and of a gradient by parameter group that is promised wherever the
// inputs' own rounding does not make more.
inline constexpr double kPromise = 1e-3;
// Times the change that half-ulp rounding of the inputs makes, beyond which an error is the program's own.
inline constexpr double kConditioning = 32;

// float64: within the promise. inputs: above it, but not more than rounding of the inputs explains. known: a
// stated limit of the formulas (known_limits.hpp). undecided: rounding decides nearly everywhere, or the
// numbers are beyond single precision; only what must always hold was asked. failed: anything else.
enum class Outcome { float64, inputs, known, undecided, failed };
inline constexpr std::size_t kOutcomes = 5;
std::string_view to_string(Outcome outcome);

// What is wrong with a failed case.
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
  std::string limit;    // of `known`: its name
  double rounding = 0;  // of `known`: half an ulp times the number that the limit names
  std::string problem;  // of `failed`: what is wrong
  double value_error = 0, gradient_error = 0;  // relative 2-norms over the decided pixels
  double value_floor = 0, gradient_floor = 0;  // what half-ulp rounding of the inputs makes
  std::string worst_group;
  std::size_t drawn = 0, pixels = 0, undecided = 0;
};

// The half of the work that needs no device; cases may be prepared in parallel.
struct Expectation {
  std::vector<float> all_weights;  // properties are asked of these
  std::vector<float> weights;      // of undecided pixels 0: these are compared
  oracle::Study study;
};
Expectation expect(const Case& c);

// The device's half. A refusal or a failure of the device is a failed verdict.
Verdict answer(const Case& c, const Expectation& expected, DeviceRunner& runner);
inline Verdict examine(const Case& c, DeviceRunner& runner) { return answer(c, expect(c), runner); }

}  // namespace ubs::stress
