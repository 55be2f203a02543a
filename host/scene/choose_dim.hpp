// SPDX-License-Identifier: Apache-2.0
// The dimensions that a data set can teach a model anything about (`--dim auto`).
#pragma once

#include <span>
#include <string>

#include "host/scene/dataset.hpp"

namespace ubs {

struct DimChoice {
  int dim = 6;
  std::string reason;  // one line: what was looked at and what follows
};

// From the cameras of the training views alone: time and further query values are used where they differ
// between views, the direction where the scene is seen from directions that differ by more than half a
// degree. Throws Error(data) where there are no views.
DimChoice choose_dim(std::span<const View> train);

}  // namespace ubs
