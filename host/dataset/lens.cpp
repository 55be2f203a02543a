// SPDX-License-Identifier: Apache-2.0
// See lens.hpp. OpenCV supports only two of these models (in its modules calib3d and fisheye), and its origin
// is the centre of the first pixel, so all formulas are implemented here. Tests compare them with pycolmap
// and with OpenCV.
#include "host/dataset/lens.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"

namespace ubs {
namespace {

using Distort = PlanePoint (*)(const LensCoefficients& k, const PlanePoint& p);

// Solves distort(k, p) = target for p by Newton's method with a numerical Jacobian. A step is halved until it
// reduces the residual. A solution at which the determinant of the Jacobian is negative is rejected, because
// distort() is not one-to-one there: two values of p have the same target.
std::optional<PlanePoint> invert(Distort distort, const LensCoefficients& k, const PlanePoint& target) {
  double x = target[0], y = target[1];
  constexpr double kStep = 1e-6;
  const auto residual = [&](double px, double py) {
    const PlanePoint d = distort(k, {px, py});
    return PlanePoint{d[0] - target[0], d[1] - target[1]};
  };
  PlanePoint r = residual(x, y);
  double det = 1;
  for (int iteration = 0; iteration < 60; ++iteration) {
    const PlanePoint rx1 = residual(x + kStep, y), rx0 = residual(x - kStep, y);
    const PlanePoint ry1 = residual(x, y + kStep), ry0 = residual(x, y - kStep);
    const double a = (rx1[0] - rx0[0]) / (2 * kStep), b = (ry1[0] - ry0[0]) / (2 * kStep);
    const double c = (rx1[1] - rx0[1]) / (2 * kStep), d = (ry1[1] - ry0[1]) / (2 * kStep);
    det = a * d - b * c;
    if (std::hypot(r[0], r[1]) < 1e-13) break;
    if (!(std::abs(det) > 1e-12)) return std::nullopt;
    const double sx = (d * r[0] - b * r[1]) / det, sy = (a * r[1] - c * r[0]) / det;
    double factor = 1;
    PlanePoint next{};
    for (; factor > 1e-4; factor /= 2) {
      next = residual(x - factor * sx, y - factor * sy);
      if (std::hypot(next[0], next[1]) < std::hypot(r[0], r[1])) break;
    }
    if (factor <= 1e-4) break;
    x -= factor * sx, y -= factor * sy, r = next;
  }
  if (!(std::hypot(r[0], r[1]) < 1e-7 && det > 0 && std::isfinite(x) && std::isfinite(y)))
    return std::nullopt;
  return PlanePoint{x, y};
}

// The following two functions are for lenses whose formula distorts positions in the plane z = 1. Such lenses
// only see points in front of the camera.
template <Distort distort>
std::optional<PlanePoint> project_plane(const LensCoefficients& k, const Ray& ray) {
  if (!(ray[2] > 0)) return std::nullopt;
  return distort(k, {ray[0] / ray[2], ray[1] / ray[2]});
}

template <Distort distort>
std::optional<Ray> unproject_plane(const LensCoefficients& k, const PlanePoint& position) {
  const auto p = invert(distort, k, position);
  if (!p) return std::nullopt;
  return Ray{(*p)[0], (*p)[1], 1};
}

// The following two functions are for lenses whose formula distorts positions in the equidistant image, in
// which the distance from the centre is the angle to the optical axis. Such lenses see more than half of all
// directions if their formula is valid for angles above 90 degrees.
template <Distort distort>
std::optional<PlanePoint> project_angle(const LensCoefficients& k, const Ray& ray) {
  const double r = std::hypot(ray[0], ray[1]);
  // The position of a point directly behind the camera is not defined.
  if (r == 0 && !(ray[2] > 0)) return std::nullopt;
  const double ratio = r > 1e-12 * std::abs(ray[2]) ? std::atan2(r, ray[2]) / r : 1 / ray[2];
  return distort(k, {ratio * ray[0], ratio * ray[1]});
}

template <Distort distort>
std::optional<Ray> unproject_angle(const LensCoefficients& k, const PlanePoint& position) {
  const auto p = invert(distort, k, position);
  if (!p) return std::nullopt;
  const double angle = std::hypot((*p)[0], (*p)[1]);
  if (angle > std::numbers::pi) return std::nullopt;
  const double ratio = angle > 1e-12 ? std::sin(angle) / angle : 1;
  return Ray{ratio * (*p)[0], ratio * (*p)[1], std::cos(angle)};
}

// Coefficients k1 k2 p1 p2 k3 k4 k5 k6: rational radial and tangential distortion.
PlanePoint distort_opencv(const LensCoefficients& k, const PlanePoint& p) {
  const auto [x, y] = p;
  const double r2 = x * x + y * y;
  const double radial =
      (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
  return {x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
          y * radial + 2 * k[3] * x * y + k[2] * (r2 + 2 * y * y)};
}

// Coefficients k1 k2 k3 k4 p1 p2 skew: radial distortion up to the eighth power, as Metashape and RealityScan
// have it. `skew` is the part of the vertical position that is added to the horizontal one.
PlanePoint distort_brown(const LensCoefficients& k, const PlanePoint& p) {
  const auto [x, y] = p;
  const double r2 = x * x + y * y, radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])));
  const double u = x * radial + 2 * k[4] * x * y + k[5] * (r2 + 2 * x * x);
  const double v = y * radial + 2 * k[5] * x * y + k[4] * (r2 + 2 * y * y);
  return {u + k[6] * v, v};
}

// Coefficients k1 k2 k3 k4.
PlanePoint distort_fisheye(const LensCoefficients& k, const PlanePoint& p) {
  const double t2 = p[0] * p[0] + p[1] * p[1];
  const double ratio = 1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])));
  return {p[0] * ratio, p[1] * ratio};
}

// Coefficients k1 k2 p1 p2 k3 k4 sx1 sy1.
PlanePoint distort_thin_prism(const LensCoefficients& k, const PlanePoint& p) {
  const auto [u, v] = p;
  const double r2 = u * u + v * v, radial = r2 * (k[0] + r2 * (k[1] + r2 * (k[4] + r2 * k[5])));
  return {u + u * radial + 2 * k[2] * u * v + k[3] * (r2 + 2 * u * u) + k[6] * r2,
          v + v * radial + 2 * k[3] * u * v + k[2] * (r2 + 2 * v * v) + k[7] * r2};
}

// Coefficients k0 .. k5 p0 p1 s0 .. s3. The tangential and prism terms apply to the radially distorted
// position.
PlanePoint distort_rad_tan_thin_prism(const LensCoefficients& k, const PlanePoint& p) {
  const double t2 = p[0] * p[0] + p[1] * p[1];
  double radial = 0;
  for (int i = 5; i >= 0; --i) radial = t2 * (k[static_cast<std::size_t>(i)] + radial);
  const double u = p[0] * (1 + radial), v = p[1] * (1 + radial), r2 = u * u + v * v;
  return {u + (2 * u * u + r2) * k[6] + 2 * u * v * k[7] + r2 * (k[8] + r2 * k[9]),
          v + (2 * v * v + r2) * k[7] + 2 * u * v * k[6] + r2 * (k[10] + r2 * k[11])};
}

// Coefficient omega: the distorted radius is atan(2 r tan(omega / 2)) / omega.
std::optional<PlanePoint> project_fov(const LensCoefficients& k, const Ray& ray) {
  if (!(ray[2] > 0)) return std::nullopt;
  const double omega = k[0], x = ray[0] / ray[2], y = ray[1] / ray[2], r = std::hypot(x, y);
  if (std::abs(omega) < 1e-9) return PlanePoint{x, y};
  const double slope = 2 * std::tan(omega / 2);
  const double ratio = r > 1e-8 ? std::atan(r * slope) / (r * omega) : slope / omega;
  return PlanePoint{x * ratio, y * ratio};
}

std::optional<Ray> unproject_fov(const LensCoefficients& k, const PlanePoint& position) {
  const double omega = k[0], r = std::hypot(position[0], position[1]);
  if (std::abs(omega) < 1e-9) return Ray{position[0], position[1], 1};
  if (!(std::abs(r * omega) < std::numbers::pi / 2)) return std::nullopt;
  const double slope = 2 * std::tan(omega / 2);
  const double ratio = r > 1e-8 ? std::tan(r * omega) / (r * slope) : omega / slope;
  return Ray{position[0] * ratio, position[1] * ratio, 1};
}

// Coefficient k: the ray of the distorted position p is (p, 1 + k |p|^2). For the ray (x, y, z), the position
// is p = s (x, y), where s is a solution of a quadratic equation. Of its two solutions, the one that tends to
// 1/z for small k is used. If k is negative, the lens can see angles above 90 degrees to its axis.
std::optional<PlanePoint> project_division(const LensCoefficients& k, const Ray& ray) {
  const auto [x, y, z] = ray;
  const double discriminant = z * z - 4 * k[0] * (x * x + y * y);
  if (!(discriminant >= 0)) return std::nullopt;
  const double denominator = z + std::sqrt(discriminant);
  if (!(denominator > 0)) return std::nullopt;
  return PlanePoint{2 * x / denominator, 2 * y / denominator};
}

std::optional<Ray> unproject_division(const LensCoefficients& k, const PlanePoint& p) {
  const double bend = k[0] * (p[0] * p[0] + p[1] * p[1]);
  // For positive k, positions beyond the largest image radius belong to the other solution of the equation.
  if (!(bend < 1)) return std::nullopt;
  return Ray{p[0], p[1], 1 + bend};
}

// Coefficients alpha beta (extended unified camera model): position = (x, y) / (alpha d + (1 - alpha) z) with
// d^2 = beta (x^2 + y^2) + z^2. The image ends at the rays with z = -w d, where w depends on alpha. If alpha
// > 1/2, w is (1 - alpha) / alpha, and these are the rays with the largest distance from the image centre.
// Otherwise w is alpha / (1 - alpha), and these are the rays for which the denominator is 0.
std::optional<PlanePoint> project_eucm(const LensCoefficients& k, const Ray& ray) {
  const auto [x, y, z] = ray;
  const double alpha = k[0], d = std::sqrt(k[1] * (x * x + y * y) + z * z);
  const double w = alpha > 0.5 ? (1 - alpha) / alpha : alpha / (1 - alpha);
  const double denominator = alpha * d + (1 - alpha) * z;
  if (!(z > -w * d && denominator > 0)) return std::nullopt;
  return PlanePoint{x / denominator, y / denominator};
}

std::optional<Ray> unproject_eucm(const LensCoefficients& k, const PlanePoint& p) {
  const double alpha = k[0], br2 = k[1] * (p[0] * p[0] + p[1] * p[1]);
  const double square = 1 - (2 * alpha - 1) * br2;
  if (!(square >= 0)) return std::nullopt;
  return Ray{p[0], p[1], (1 - alpha * alpha * br2) / (alpha * std::sqrt(square) + 1 - alpha)};
}

// The position consists of the longitude and the latitude (positive downwards), in radians. The image centre
// is the forward direction.
std::optional<PlanePoint> project_equirectangular(const LensCoefficients&, const Ray& ray) {
  return PlanePoint{std::atan2(ray[0], ray[2]), std::atan2(ray[1], std::hypot(ray[0], ray[2]))};
}

std::optional<Ray> unproject_equirectangular(const LensCoefficients&, const PlanePoint& p) {
  constexpr double kSlack = 1e-9;  // tolerance for positions on the borders of the image
  if (std::abs(p[0]) > std::numbers::pi + kSlack || std::abs(p[1]) > std::numbers::pi / 2 + kSlack)
    return std::nullopt;
  return Ray{std::sin(p[0]) * std::cos(p[1]), std::sin(p[1]), std::cos(p[0]) * std::cos(p[1])};
}

constexpr LensFormula kOpencv{"k1 k2 p1 p2 k3 k4 k5 k6", project_plane<distort_opencv>,
                              unproject_plane<distort_opencv>, 8};
constexpr LensFormula kBrown{"k1 k2 k3 k4 p1 p2 skew", project_plane<distort_brown>,
                             unproject_plane<distort_brown>, 7};
constexpr LensFormula kFisheye{"k1 k2 k3 k4", project_angle<distort_fisheye>,
                               unproject_angle<distort_fisheye>, -1};
constexpr LensFormula kThinPrism{"k1 k2 p1 p2 k3 k4 sx1 sy1", project_angle<distort_thin_prism>,
                                 unproject_angle<distort_thin_prism>, -1};
constexpr LensFormula kRadTanThinPrism{"k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
                                       project_angle<distort_rad_tan_thin_prism>,
                                       unproject_angle<distort_rad_tan_thin_prism>, -1};
constexpr LensFormula kFov{"omega", project_fov, unproject_fov, 1};
constexpr LensFormula kDivision{"k", project_division, unproject_division, 1};
constexpr LensFormula kEucm{"alpha beta", project_eucm, unproject_eucm, 1};
constexpr LensFormula kEquirectangular{"", project_equirectangular, unproject_equirectangular, -1, true};

// A new model needs a row here, and a formula above unless it shares one. The coefficients in the fifth
// column (LensModel::json_extra) are those of nerfstudio, which reads k1 k2 p1 p2 k3 for all its perspective
// cameras and k1 to k4 for all its fisheye cameras.
constexpr std::string_view kPerspective = "k1 k2 p1 p2 k3", kFisheyeExtra = "k1 k2 k3 k4";
constexpr LensModel kModels[] = {
    {0, "SIMPLE_PINHOLE", "", "f cx cy", kPerspective, &kOpencv},
    {1, "PINHOLE", "PERSPECTIVE", "fx fy cx cy", kPerspective, &kOpencv},
    {2, "SIMPLE_RADIAL", "", "f cx cy k1", kPerspective, &kOpencv},
    {3, "RADIAL", "", "f cx cy k1 k2", kPerspective, &kOpencv},
    {4, "OPENCV", "", "fx fy cx cy k1 k2 p1 p2", kPerspective, &kOpencv},
    {5, "OPENCV_FISHEYE", "", "fx fy cx cy k1 k2 k3 k4", "", &kFisheye},
    {6, "FULL_OPENCV", "", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6", "", &kOpencv},
    {7, "FOV", "", "fx fy cx cy omega", "", &kFov},
    {8, "SIMPLE_RADIAL_FISHEYE", "", "f cx cy k1", kFisheyeExtra, &kFisheye},
    {9, "RADIAL_FISHEYE", "", "f cx cy k1 k2", kFisheyeExtra, &kFisheye},
    {10, "THIN_PRISM_FISHEYE", "", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1", "", &kThinPrism},
    {11, "RAD_TAN_THIN_PRISM_FISHEYE", "", "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3", "",
     &kRadTanThinPrism},
    {12, "SIMPLE_DIVISION", "", "f cx cy k", "", &kDivision},
    {13, "DIVISION", "", "fx fy cx cy k", "", &kDivision},
    {14, "SIMPLE_FISHEYE", "", "f cx cy", kFisheyeExtra, &kFisheye},
    {15, "FISHEYE", "", "fx fy cx cy", kFisheyeExtra, &kFisheye},
    {16, "EUCM", "", "fx fy cx cy alpha beta", "", &kEucm},
    {17, "EQUIRECTANGULAR", "", "w h", "", &kEquirectangular},
    {-1, "BROWN", "", "fx fy cx cy k1 k2 k3 k4 p1 p2 skew", "", &kBrown},
};

}  // namespace

std::vector<std::string_view> words_of(std::string_view names) {
  std::vector<std::string_view> words;
  while (!names.empty()) {
    const std::size_t end = std::min(names.find(' '), names.size());
    words.push_back(names.substr(0, end));
    names.remove_prefix(std::min(end + 1, names.size()));
  }
  return words;
}

std::span<const LensModel> lens_models() { return kModels; }

std::string known_lens_models() {
  std::vector<std::string> models;
  for (const LensModel& model : kModels)
    if (model.number >= 0) models.push_back(fmt::format("{} {}", model.number, model.name));
  return fmt::format("{}", fmt::join(models, ", "));
}

bool Lens::distorted() const {
  if (!formula) return false;
  if (formula->zero_for_pinhole < 0) return true;
  return std::any_of(k.begin(), k.begin() + formula->zero_for_pinhole, [](double v) { return v != 0; });
}

Lens Lens::scaled_to(int new_width, int new_height) const {
  Lens result = *this;
  const double sx = static_cast<double>(new_width) / width, sy = static_cast<double>(new_height) / height;
  result.fx *= sx, result.cx *= sx, result.fy *= sy, result.cy *= sy;
  result.width = new_width, result.height = new_height;
  return result;
}

bool Lens::set(std::string_view parameter, double value) {
  // The width of an equirectangular image corresponds to 360 degrees and its height to 180 degrees.
  if (parameter == "w") {
    fx = value / (2 * std::numbers::pi), cx = value / 2;
  } else if (parameter == "h") {
    fy = value / std::numbers::pi, cy = value / 2;
  } else if (parameter == "f") {
    fx = fy = value;
  } else if (parameter == "fx") {
    fx = value;
  } else if (parameter == "fy") {
    fy = value;
  } else if (parameter == "cx") {
    cx = value;
  } else if (parameter == "cy") {
    cy = value;
  } else {
    if (!formula) return false;
    const std::vector<std::string_view> names = words_of(formula->coefficients);
    const auto found = std::ranges::find(names, parameter);
    if (found == names.end()) return false;
    k[static_cast<std::size_t>(found - names.begin())] = value;
  }
  return true;
}

void check_lens(const Lens& lens, const std::string& where) {
  if (!(lens.fx > 0 && lens.fy > 0)) fail(ErrorKind::data, "{}: the focal length must be positive", where);
  if (lens.formula == &kEucm && !(lens.k[0] >= 0 && lens.k[0] <= 1 && lens.k[1] > 0))
    fail(ErrorKind::data,
         "{}: EUCM with alpha = {} and beta = {}: alpha must be from 0 to 1, and beta must be positive",
         where, lens.k[0], lens.k[1]);
}

std::optional<PlanePoint> project_ray(const Lens& lens, const Ray& ray) {
  std::optional<PlanePoint> p;
  if (lens.formula)
    p = lens.formula->project(lens.k, ray);
  else if (ray[2] > 0)
    p = PlanePoint{ray[0] / ray[2], ray[1] / ray[2]};
  if (!p) return std::nullopt;
  return PlanePoint{lens.fx * (*p)[0] + lens.cx, lens.fy * (*p)[1] + lens.cy};
}

std::optional<Ray> pixel_ray(const Lens& lens, double column, double row) {
  const PlanePoint p{(column - lens.cx) / lens.fx, (row - lens.cy) / lens.fy};
  if (!lens.formula) return Ray{p[0], p[1], 1};
  return lens.formula->unproject(lens.k, p);
}

}  // namespace ubs
