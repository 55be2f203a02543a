// SPDX-License-Identifier: Apache-2.0
// Form is a variant of the method together with N and query_grad. forms() lists the forms for which a build
// contains vectors, which are the expected float64 results that devices are checked with.
#pragma once

#include <vector>

#include "host/scene/model_variant.hpp"

namespace ubs::check {

struct Form {
  int dim = 6;
  ModelVariant variant = {};
  bool query_grad = false;

  bool operator==(const Form&) const = default;
};

// Returns the table of forms. To add a form, only a line in this table is needed; the build computes its
// vectors.
const std::vector<Form>& forms();

// Returns the index in forms() of the form with which `form` is checked. This is `form` itself if it is in
// the table. Otherwise it is the form of the same N in which the most switches agree, including query_grad;
// among equals, it is the first in the table.
std::size_t nearest_form(const Form& form);

}  // namespace ubs::check
