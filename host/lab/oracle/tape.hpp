// SPDX-License-Identifier: Apache-2.0
// Tape records operations for reverse-mode automatic differentiation in double precision. Only the oracle
// uses it.
// Formulas are templates over the scalar type. With `double`, they give the value. With `Var`, they also
// record one node per operation, with at most two parents and the partial derivatives. Tape::reverse
// processes the nodes in reverse order.
// Branches in a formula test value(x), and the derivative is that of the branch taken.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace ubs::oracle {

class Tape {
 public:
  static constexpr std::int32_t kConstant = -1;

  std::int32_t push(std::int32_t a, double da, std::int32_t b, double db) {
    nodes_.push_back({a, b, da, db});
    return static_cast<std::int32_t>(nodes_.size()) - 1;
  }
  void clear() {
    nodes_.clear();
    adjoints_.clear();
  }
  // Sets all adjoints to 0. Call this before seeding other outputs of the same recording.
  void forget_adjoints() { adjoints_.assign(nodes_.size(), 0.0); }
  void seed(std::int32_t node, double adjoint) {
    if (node == kConstant) return;
    adjoints_.resize(nodes_.size(), 0.0);
    adjoints_[node] += adjoint;
  }
  // Computes the adjoints of all nodes. Nodes whose adjoint is 0 are skipped, so that an unused infinite
  // partial derivative never forms 0 * inf.
  void reverse() {
    adjoints_.resize(nodes_.size(), 0.0);
    for (std::size_t i = nodes_.size(); i-- > 0;) {
      const double g = adjoints_[i];
      if (g == 0.0) continue;
      const Node& node = nodes_[i];
      if (node.a != kConstant) adjoints_[node.a] += g * node.da;
      if (node.b != kConstant) adjoints_[node.b] += g * node.db;
    }
  }
  double adjoint(std::int32_t node) const { return node == kConstant ? 0.0 : adjoints_[node]; }

 private:
  struct Node {
    std::int32_t a, b;
    double da, db;
  };
  std::vector<Node> nodes_;
  std::vector<double> adjoints_;
};

// Var is a number that records how it was computed. Without a tape it is a constant.
class Var {
 public:
  Var(double constant = 0.0) : value_(constant) {}  // implicit, so that constants and variables can be mixed
  static Var input(Tape& tape, double value) {
    return Var(value, &tape, tape.push(Tape::kConstant, 0, Tape::kConstant, 0));
  }
  static Var unary(const Var& a, double value, double da) {
    if (!a.tape_) return Var(value);
    return Var(value, a.tape_, a.tape_->push(a.node_, da, Tape::kConstant, 0));
  }
  static Var binary(const Var& a, const Var& b, double value, double da, double db) {
    Tape* tape = a.tape_ ? a.tape_ : b.tape_;
    if (!tape) return Var(value);
    return Var(value, tape, tape->push(a.node_, da, b.node_, db));
  }
  double value() const { return value_; }
  std::int32_t node() const { return node_; }

  friend Var operator+(const Var& a, const Var& b) { return binary(a, b, a.value_ + b.value_, 1, 1); }
  friend Var operator-(const Var& a, const Var& b) { return binary(a, b, a.value_ - b.value_, 1, -1); }
  friend Var operator*(const Var& a, const Var& b) {
    return binary(a, b, a.value_ * b.value_, b.value_, a.value_);
  }
  friend Var operator/(const Var& a, const Var& b) {
    const double quotient = a.value_ / b.value_;
    return binary(a, b, quotient, 1 / b.value_, -quotient / b.value_);
  }
  friend Var operator-(const Var& a) { return unary(a, -a.value_, -1); }
  Var& operator+=(const Var& b) { return *this = *this + b; }
  Var& operator-=(const Var& b) { return *this = *this - b; }

 private:
  Var(double value, Tape* tape, std::int32_t node) : value_(value), tape_(tape), node_(node) {}
  double value_;
  Tape* tape_ = nullptr;
  std::int32_t node_ = Tape::kConstant;
};

inline double value(double x) { return x; }
inline double value(const Var& x) { return x.value(); }

inline Var exp(const Var& x) {
  const double e = std::exp(x.value());
  return Var::unary(x, e, e);
}
inline Var sin(const Var& x) { return Var::unary(x, std::sin(x.value()), std::cos(x.value())); }
inline Var cos(const Var& x) { return Var::unary(x, std::cos(x.value()), -std::sin(x.value())); }
inline Var log1p(const Var& x) { return Var::unary(x, std::log1p(x.value()), 1 / (1 + x.value())); }
inline Var sqrt(const Var& x) {
  const double root = std::sqrt(x.value());
  return Var::unary(x, root, 0.5 / root);
}

// The sigmoid is one node of the tape. If it were composed of the operations of 1/(1+exp(-x)), the product of
// their partial derivatives would be 0 * inf for x below -709.
inline double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }
inline Var sigmoid(const Var& x) {
  const double s = sigmoid(x.value());
  return Var::unary(x, s, s * (1 - s));
}

// Computes (1-r)^beta for r in [0,1). For beta < 1 its slope in r diverges at the rim of the support (r = 1).
// By convention, the formula of this slope uses kRimGuard instead of 1-r if 1-r is smaller. Plain
// differentiation would not do this. The value and the derivative with respect to beta, which is bounded, are
// not changed. At kRimGuard, single precision resolves 1-r to 2%
// (docs/results/2026-11-20-stability-sweeps.md).
inline constexpr double kRimGuard = 1e-5;
inline double rim_power(double r, double beta) { return std::exp(beta * std::log1p(-r)); }
inline Var rim_power(const Var& r, const Var& beta) {
  const double v = rim_power(r.value(), beta.value());
  const double slope = -v * beta.value() / std::max(1 - r.value(), kRimGuard);
  return Var::binary(r, beta, v, slope, v * std::log1p(-r.value()));
}

}  // namespace ubs::oracle
