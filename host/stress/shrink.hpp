// SPDX-License-Identifier: Apache-2.0
// From a case that fails to a smaller one that fails in the same way: splats are left out, the image is
// cropped, values are set to neutral ones or rounded, for as long as the fault stays.
#pragma once

#include <functional>

#include "host/stress/judge.hpp"

namespace ubs::stress {

struct Shrunk {
  Case smallest;
  Verdict verdict;  // of `smallest`
  int evaluations = 0;
};

// `examine` judges a case, 600 times at the most; `failed` is its verdict on `c`.
Shrunk shrink(const Case& c, const Verdict& failed, const std::function<Verdict(const Case&)>& examine);

}  // namespace ubs::stress
