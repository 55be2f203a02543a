// SPDX-License-Identifier: Apache-2.0
// y = factor * x^exponent by least squares in logarithms: how something grows.
#pragma once

#include <cmath>
#include <span>

#include "host/base/error.hpp"

namespace ubs {

struct PowerLaw {
  double factor = 0, exponent = 0;
  double operator()(double x) const { return factor * std::pow(x, exponent); }
};

// At least two different x; all values positive.
inline PowerLaw fit_power_law(std::span<const double> x, std::span<const double> y) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  if (x.size() != y.size()) fail(ErrorKind::internal, "power law: {} x and {} y values", x.size(), y.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!(x[i] > 0 && y[i] > 0)) fail(ErrorKind::internal, "power law through ({}, {})", x[i], y[i]);
    const double u = std::log(x[i]), v = std::log(y[i]);
    n += 1;
    sx += u;
    sy += v;
    sxx += u * u;
    sxy += u * v;
  }
  const double spread = n * sxx - sx * sx;
  if (!(spread > 0)) fail(ErrorKind::internal, "a power law needs two different x");
  const double exponent = (n * sxy - sx * sy) / spread;
  return {std::exp((sy - exponent * sx) / n), exponent};
}

}  // namespace ubs
