// SPDX-License-Identifier: Apache-2.0
// whole_sweep() returns whether tests must cover all variants of the method, all tuned constants and similar
// cases. Each of them needs a compilation, so tests only cover a sample by default. They cover all cases if
// the environment variable UBS_TEST_ALL is set.
#pragma once

#include <cstdlib>

namespace ubs::test {

inline bool whole_sweep() { return std::getenv("UBS_TEST_ALL") != nullptr; }

}  // namespace ubs::test
