// SPDX-License-Identifier: Apache-2.0
// whole_sweep() returns whether tests must cover all variants, constants and similar cases. Each of them
// costs a compilation. So only a sample runs by default, and all of them run with UBS_TEST_ALL in the
// environment.
#pragma once

#include <cstdlib>

namespace ubs::test {

inline bool whole_sweep() { return std::getenv("UBS_TEST_ALL") != nullptr; }

}  // namespace ubs::test
