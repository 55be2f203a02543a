// SPDX-License-Identifier: Apache-2.0
// Frames of a sequence: `first`, then every `step`-th one before `end`.
#pragma once

#include <climits>

namespace ubs {

struct FrameRange {
  int first = 0, end = INT_MAX, step = 1;
};

}  // namespace ubs
