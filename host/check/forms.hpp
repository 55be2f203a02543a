// SPDX-License-Identifier: Apache-2.0
// A Form consists of a variant of the method, N and the setting query_grad. forms() lists the forms for which
// a build contains the float64 results that devices are checked with (vectors.hpp).
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

// Returns the table of forms. To add a form, add a line to this table; the build then computes the float64
// results for the form.
const std::vector<Form>& forms();

// Returns the index in forms() of the form that is checked in place of `form`. If `form` is in the table,
// this is `form` itself. Otherwise it is the form with the same N that has the same value as `form` for most
// of the switches, including query_grad. If several forms have equally many, it is the first of them in the
// table.
std::size_t nearest_form(const Form& form);

}  // namespace ubs::check
