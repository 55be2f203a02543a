// SPDX-License-Identifier: Apache-2.0
// choose_dim() chooses the dimensions of a model for `--dim auto`: those that vary between the views of a
// data set.
#pragma once

#include <span>
#include <string>

#include "host/scene/dataset.hpp"

namespace ubs {

struct DimChoice {
  int dim = 6;
  std::string reason;  // one line of text: the properties of the data that led to this choice
};

// Chooses the number of dimensions N from the cameras of the training views; images are not read. Time and
// further query values are used if they differ between views. The direction is used if the scene is seen from
// directions that differ by more than half a degree, or if more than two other query values are used. Throws
// Error(data) if there are no views.
DimChoice choose_dim(std::span<const View> train);

}  // namespace ubs
