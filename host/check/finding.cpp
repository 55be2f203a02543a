// SPDX-License-Identifier: Apache-2.0
#include "host/check/finding.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace ubs::check {

void WorstFinding::add(const std::string& quantity, double error, double bound) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  if (!std::isfinite(error)) return refuse(quantity + " has values that are not finite");
  const double share = error <= bound ? (bound > 0 ? error / bound : 0)
                       : bound > 0    ? error / bound
                                      : kInfinite;
  if (!(share > share_)) return;
  share_ = share;
  worst_.quantity = quantity, worst_.error = error, worst_.bound = bound;
}

void WorstFinding::refuse(const std::string& problem) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  if (share_ == kInfinite) return;
  share_ = worst_.error = kInfinite;
  worst_.quantity = problem, worst_.bound = 0;
}

std::string text(const Finding& f) {
  if (!std::isfinite(f.error)) return fmt::format("{}: {}", f.stage, f.quantity);
  if (f.bound == 0) return fmt::format("{}: {}: {:g} instead of 0", f.stage, f.quantity, f.error);
  return fmt::format("{}: {} has an error of {:.2e}, but at most {:.2e} is allowed", f.stage, f.quantity,
                     f.error, f.bound);
}

}  // namespace ubs::check
