// SPDX-License-Identifier: Apache-2.0
// Matrix is a dense matrix of the scalars of tape.hpp. The file also contains the few textbook algorithms
// that the oracle needs.
#pragma once

#include <cmath>
#include <span>
#include <vector>

#include "host/lab/oracle/tape.hpp"

namespace ubs::oracle {

template <class S>
class Matrix {
 public:
  Matrix(int rows, int columns) : rows_(rows), columns_(columns), data_(rows * columns, S(0)) {}
  static Matrix identity(int n) {
    Matrix result(n, n);
    for (int i = 0; i < n; ++i) result(i, i) = S(1);
    return result;
  }
  S& operator()(int i, int j) { return data_[i * columns_ + j]; }
  const S& operator()(int i, int j) const { return data_[i * columns_ + j]; }
  int rows() const { return rows_; }
  int columns() const { return columns_; }
  Matrix transposed() const {
    Matrix result(columns_, rows_);
    for (int i = 0; i < rows_; ++i)
      for (int j = 0; j < columns_; ++j) result(j, i) = (*this)(i, j);
    return result;
  }
  Matrix block(int row, int column, int rows, int columns) const {
    Matrix result(rows, columns);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) result(i, j) = (*this)(row + i, column + j);
    return result;
  }
  friend Matrix operator*(const Matrix& a, const Matrix& b) {
    Matrix result(a.rows_, b.columns_);
    for (int i = 0; i < a.rows_; ++i)
      for (int j = 0; j < b.columns_; ++j)
        for (int k = 0; k < a.columns_; ++k) result(i, j) += a(i, k) * b(k, j);
    return result;
  }
  friend Matrix operator+(const Matrix& a, const Matrix& b) {
    Matrix result(a.rows_, a.columns_);
    for (int i = 0; i < a.rows_ * a.columns_; ++i) result.data_[i] = a.data_[i] + b.data_[i];
    return result;
  }
  friend Matrix operator-(const Matrix& a, const Matrix& b) {
    Matrix result(a.rows_, a.columns_);
    for (int i = 0; i < a.rows_ * a.columns_; ++i) result.data_[i] = a.data_[i] - b.data_[i];
    return result;
  }

 private:
  int rows_, columns_;
  std::vector<S> data_;
};

inline Matrix<double> absolute(Matrix<double> a) {
  for (int i = 0; i < a.rows(); ++i)
    for (int j = 0; j < a.columns(); ++j) a(i, j) = std::abs(a(i, j));
  return a;
}

// Returns the inverse by Gauss-Jordan elimination without pivoting. This is sufficient for triangular
// matrices, and for matrices whose symmetric part is positive definite.
template <class S>
Matrix<S> inverse(Matrix<S> a) {
  const int n = a.rows();
  Matrix<S> result = Matrix<S>::identity(n);
  for (int k = 0; k < n; ++k) {
    const S pivot = a(k, k);
    for (int j = 0; j < n; ++j) {
      a(k, j) = a(k, j) / pivot;
      result(k, j) = result(k, j) / pivot;
    }
    for (int i = 0; i < n; ++i) {
      if (i == k) continue;
      const S factor = a(i, k);
      for (int j = 0; j < n; ++j) {
        a(i, j) -= factor * a(k, j);
        result(i, j) -= factor * result(k, j);
      }
    }
  }
  return result;
}

// Returns the lower triangular factor L of a = L L^T, with a positive diagonal. If a pivot is not positive, L
// contains NaN.
template <class S>
Matrix<S> cholesky(const Matrix<S>& a) {
  using std::sqrt;
  Matrix<S> result(a.rows(), a.rows());
  for (int j = 0; j < a.rows(); ++j)
    for (int i = j; i < a.rows(); ++i) {
      S sum = a(i, j);
      for (int k = 0; k < j; ++k) sum -= result(i, k) * result(j, k);
      result(i, j) = i == j ? sqrt(sum) : sum / result(j, j);
    }
  return result;
}

template <class S>
std::vector<S> forward_substitution(const Matrix<S>& lower, std::span<const S> right) {
  std::vector<S> result;
  for (int i = 0; i < lower.rows(); ++i) {
    S sum = right[i];
    for (int k = 0; k < i; ++k) sum -= lower(i, k) * result[k];
    result.push_back(sum / lower(i, i));
  }
  return result;
}

// Minimum pivot of the factor of the covariance of the query dimensions (kernels/limits.h). Query scales are
// clamped, so only a row of zeros has a smaller pivot. A pivot below kPivotNoise times the length of its row
// consists only of rounding errors of single precision.
inline constexpr double kPivotAbsolute = 1e-30, kPivotNoise = 1e-7;

// LowerOrthogonal is the factorisation B = L Q, where the rows of Q are orthonormal. It is computed by
// Gram-Schmidt orthogonalisation, which is repeated once, so that errors grow with the condition number of B
// and not with its square. `floored` is true if, up to rounding errors of single precision, a row depends
// linearly on the rows before it. If a pivot is not above kPivotAbsolute, it is replaced by kPivotAbsolute.
template <class S>
struct LowerOrthogonal {
  Matrix<S> lower, rows;
  bool floored = false;
};

template <class S>
LowerOrthogonal<S> lower_orthogonal(const Matrix<S>& b) {
  using std::sqrt;
  LowerOrthogonal<S> result{Matrix<S>(b.rows(), b.rows()), Matrix<S>(b.rows(), b.columns())};
  for (int i = 0; i < b.rows(); ++i) {
    std::vector<S> row;
    double square = 0;
    for (int k = 0; k < b.columns(); ++k) {
      row.push_back(b(i, k));
      square += value(b(i, k)) * value(b(i, k));
    }
    for (int repeat = 0; repeat < 2; ++repeat)
      for (int j = 0; j < i; ++j) {
        S dot(0);
        for (int k = 0; k < b.columns(); ++k) dot += result.rows(j, k) * row[k];
        result.lower(i, j) += dot;
        for (int k = 0; k < b.columns(); ++k) row[k] -= dot * result.rows(j, k);
      }
    S rest(0);
    for (const S& x : row) rest += x * x;
    const double length = std::sqrt(value(rest));
    // Use twice the limit, because near the limit the result depends on the rounding of the row itself.
    result.floored = result.floored || !(length > 2 * (kPivotNoise * std::sqrt(square) + kPivotAbsolute));
    result.lower(i, i) = length > kPivotAbsolute ? sqrt(rest) : S(kPivotAbsolute);
    for (int k = 0; k < b.columns(); ++k) result.rows(i, k) = row[k] / result.lower(i, i);
  }
  return result;
}

}  // namespace ubs::oracle
