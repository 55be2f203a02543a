// SPDX-License-Identifier: Apache-2.0
// Sweeps over forms, constants and the like cost a compilation each: a sample of them runs, and all of them
// with UBS_TEST_ALL in the environment.
#pragma once

#include <cstdlib>

namespace ubs::test {

inline bool whole_sweep() { return std::getenv("UBS_TEST_ALL") != nullptr; }

}  // namespace ubs::test
