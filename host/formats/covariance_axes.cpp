// SPDX-License-Identifier: Apache-2.0
// See covariance_axes.hpp.
#include "host/formats/covariance_axes.hpp"

#include <algorithm>
#include <opencv2/core.hpp>

#include "host/scene/pose.hpp"

namespace ubs {
namespace {

std::array<double, 4> rotation_quaternion(const cv::Matx33d& r) {
  const Quaternion q =
      quaternion({r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)});
  return {q.w, q.x, q.y, q.z};
}

cv::Matx33d proper(cv::Matx33d axes) {
  if (cv::determinant(axes) < 0)
    for (int a = 0; a < 3; ++a) axes(a, 2) = -axes(a, 2);
  return axes;
}

}  // namespace

CovarianceAxes covariance_axes(const double (&covariance)[3][3]) {
  cv::Matx33d matrix, vectors;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) matrix(a, b) = covariance[a][b];
  cv::Vec3d values;
  cv::eigen(matrix, values, vectors);  // rows are eigenvectors
  CovarianceAxes axes;
  axes.rotation = rotation_quaternion(proper(vectors.t()));
  for (std::size_t k = 0; k < 3; ++k)
    axes.variance[k] = std::max({values[static_cast<int>(k)], 1e-6 * values[0], 1e-30});
  return axes;
}

CovarianceAxes covariance_axes(const Matrix3& factor) {
  cv::Matx33d matrix, u, vt;
  cv::Matx31d values;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b)
      matrix(a, b) = factor[static_cast<std::size_t>(a)][static_cast<std::size_t>(b)];
  cv::SVD::compute(matrix, values, u, vt);
  CovarianceAxes axes;
  axes.rotation = rotation_quaternion(proper(u));
  for (std::size_t k = 0; k < 3; ++k) {
    const double s = values(static_cast<int>(k));
    axes.variance[k] = s * s;
  }
  return axes;
}

}  // namespace ubs
