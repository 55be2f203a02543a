// SPDX-License-Identifier: Apache-2.0
// The forms of the method that a build has float64 vectors of, so that devices can be checked in them.
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

// The table of forms. A line here is all that another form needs: the build makes its vectors.
const std::vector<Form>& forms();

// Returns the place in forms() of the form that stands for `form` in a check: `form` itself where it is in
// the table, else the one of the same N with the most switches that agree (query_grad is one of them), the
// first of the table among equals.
std::size_t nearest_form(const Form& form);

}  // namespace ubs::check
