// SPDX-License-Identifier: Apache-2.0
// Reverse-mode differentiation in a number wider than double, for references of stiff cases: the textbook
// formulas square condition numbers up to 1e12, so that double itself keeps no more than a few digits of
// them. The scalar fits the templates of tests/reference/splat_formula.hpp.
#pragma once

#include <cfloat>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tests/reference/tape.hpp"

namespace ubs::stress {

// 113 bits of mantissa where the compiler has them; exp, log1p and the first guess of a root are taken in
// long double.
#if LDBL_MANT_DIG < 113 && defined(__SIZEOF_FLOAT128__)
__extension__ typedef __float128 Number;
#else
using Number = long double;
#endif

struct WideTape {
  struct Node {
    std::int32_t a, b;
    Number da, db;
  };
  std::int32_t push(std::int32_t a, Number da, std::int32_t b, Number db) {
    nodes.push_back({a, b, da, db});
    return static_cast<std::int32_t>(nodes.size()) - 1;
  }
  void clear() { nodes.clear(); }
  // Derivatives of node `of` with respect to the first `inputs` nodes.
  std::vector<double> gradient(std::int32_t of, std::size_t inputs) const {
    std::vector<Number> adjoint(nodes.size(), 0);
    std::vector<double> result(inputs, 0.0);
    if (of < 0) return result;
    adjoint[of] = 1;
    for (std::size_t i = nodes.size(); i-- > 0;) {
      if (adjoint[i] == 0) continue;  // an unused infinite slope never forms 0 * inf
      const Node& node = nodes[i];
      if (node.a >= 0) adjoint[node.a] += adjoint[i] * node.da;
      if (node.b >= 0) adjoint[node.b] += adjoint[i] * node.db;
    }
    for (std::size_t i = 0; i < inputs; ++i) result[i] = static_cast<double>(adjoint[i]);
    return result;
  }
  std::vector<Node> nodes;
};

class Wide {
 public:
  Wide(double constant = 0.0) : number_(constant) {}
  static Wide input(WideTape& tape, double value) { return {value, &tape, tape.push(-1, 0, -1, 0)}; }
  static Wide unary(const Wide& a, Number value, Number da) {
    return a.tape_ ? Wide(value, a.tape_, a.tape_->push(a.node_, da, -1, 0)) : Wide(value, nullptr, -1);
  }
  static Wide binary(const Wide& a, const Wide& b, Number value, Number da, Number db) {
    WideTape* tape = a.tape_ ? a.tape_ : b.tape_;
    return tape ? Wide(value, tape, tape->push(a.node_, da, b.node_, db)) : Wide(value, nullptr, -1);
  }
  Number number() const { return number_; }
  std::int32_t node() const { return node_; }

  friend Wide operator+(const Wide& a, const Wide& b) { return binary(a, b, a.number_ + b.number_, 1, 1); }
  friend Wide operator-(const Wide& a, const Wide& b) { return binary(a, b, a.number_ - b.number_, 1, -1); }
  friend Wide operator*(const Wide& a, const Wide& b) {
    return binary(a, b, a.number_ * b.number_, b.number_, a.number_);
  }
  friend Wide operator/(const Wide& a, const Wide& b) {
    const Number quotient = a.number_ / b.number_;
    return binary(a, b, quotient, 1 / b.number_, -quotient / b.number_);
  }
  friend Wide operator-(const Wide& a) { return unary(a, -a.number_, -1); }
  Wide& operator+=(const Wide& b) { return *this = *this + b; }
  Wide& operator-=(const Wide& b) { return *this = *this - b; }

 private:
  Wide(Number value, WideTape* tape, std::int32_t node) : number_(value), tape_(tape), node_(node) {}
  Number number_;
  WideTape* tape_ = nullptr;
  std::int32_t node_ = -1;
};

inline double value(const Wide& x) { return static_cast<double>(x.number()); }

inline Wide exp(const Wide& x) {
  const Number e = std::exp(static_cast<long double>(x.number()));
  return Wide::unary(x, e, e);
}
inline Wide log1p(const Wide& x) {
  return Wide::unary(x, std::log1p(static_cast<long double>(x.number())), 1 / (1 + x.number()));
}
inline Wide sqrt(const Wide& x) {
  Number root = std::sqrt(static_cast<long double>(x.number()));
  if (root > 0) root = (root + x.number() / root) / 2;  // Newton: twice the digits
  return Wide::unary(x, root, 1 / (2 * root));
}
inline Wide sigmoid(const Wide& x) {
  const Number s = 1 / (1 + Number(std::exp(-static_cast<long double>(x.number()))));
  return Wide::unary(x, s, s * (1 - s));
}
// (1-r)^beta; its slope in r is that of tests/reference/tape.hpp, which see.
inline Wide rim_power(const Wide& r, const Wide& beta) {
  const long double rest = static_cast<long double>(1 - r.number());
  const long double v =
      std::exp(static_cast<long double>(beta.number()) * std::log1p(-static_cast<long double>(r.number())));
  const long double guarded = rest > oracle::kRimGuard ? rest : static_cast<long double>(oracle::kRimGuard);
  return Wide::binary(r, beta, v, -Number(v) * beta.number() / guarded, Number(v) * std::log(rest));
}

}  // namespace ubs::stress
