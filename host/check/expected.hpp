// SPDX-License-Identifier: Apache-2.0
// The scene that a form of the method is checked on, and what float64 says about it. Made from counters; no
// files.
#pragma once

#include "host/accuracy/truth.hpp"
#include "host/check/subject.hpp"

namespace ubs::check {

struct Expected {
  accuracy::Problem problem;
  accuracy::Truth whole;
  accuracy::StageTruth stages;
};

// The half of a check that needs no device; several may be made in parallel.
Expected expect(const KernelConfig& config);

}  // namespace ubs::check
