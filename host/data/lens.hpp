// SPDX-License-Identifier: Apache-2.0
// lens_models() is the table of the camera models of COLMAP and nerfstudio: their numbers, names and
// parameters, and their projections with inverses. They are used to resample a distorted image to an ideal
// pinhole camera of the same focal length, because the rasteriser supports only pinhole cameras.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ubs {

using Ray = std::array<double, 3>;         // a direction in camera axes of COLMAP: x right, y down, z forward
using PlanePoint = std::array<double, 2>;  // a position in the image plane
using LensCoefficients = std::array<double, 12>;

// LensFormula is a projection and its inverse. Models that differ only in which coefficients they have
// (RADIAL, OPENCV, FULL_OPENCV) share one formula. Positions are relative to the principal point, in units of
// the focal length; rays may have any length.
struct LensFormula {
  std::string_view coefficients;  // names in the order of Lens::k, separated by blanks
  // nullopt if the lens maps no position to this ray, or if the formula is not defined for it.
  std::optional<PlanePoint> (*project)(const LensCoefficients& k, const Ray& ray);
  std::optional<Ray> (*unproject)(const LensCoefficients& k, const PlanePoint& position);
  // The camera is a pinhole camera if the first zero_for_pinhole coefficients are 0; -1: it is never one.
  int zero_for_pinhole;
  bool all_directions = false;  // the image shows all directions, and its left and right borders meet
};

// LensModel is a row of the table of camera models.
struct LensModel {
  int number;                     // number in COLMAP's binary files
  std::string_view name;          // name in COLMAP's files, and in transforms.json in any case
  std::string_view json_aliases;  // further names in transforms.json, separated by blanks
  std::string_view parameters;    // in COLMAP's order: f (both focal lengths), fx fy cx cy, w h, coefficients
  std::string_view json_extra;    // coefficients that transforms.json may also have
  const LensFormula* formula;
};

struct Lens {
  const LensFormula* formula = nullptr;   // nullptr: an ideal pinhole camera
  double fx = 1, fy = 1, cx = 0, cy = 0;  // [px]; the centre of pixel (0,0) is (0.5, 0.5)
  int width = 0, height = 0;
  LensCoefficients k{};

  bool operator==(const Lens&) const = default;
  bool distorted() const;  // false: an ideal pinhole camera
  Lens scaled_to(int new_width, int new_height) const;
  // Sets a parameter by its name in the table. Returns false if the lens has no parameter of this name.
  bool set(std::string_view parameter, double value);
};

// Returns the table: camera models 0 to 17 of COLMAP 4.
std::span<const LensModel> lens_models();
// Returns "number NAME, number NAME, ...", for messages.
std::string known_lens_models();
// Splits names that are separated by blanks.
std::vector<std::string_view> words_of(std::string_view names);

// Throws Error(data) whose message starts with `where` unless the focal lengths are positive and the
// coefficients are in the domain of the formula.
void check_lens(const Lens& lens, const std::string& where);

// Returns the pixel position that sees `ray`; nullopt if the lens does not see it.
std::optional<PlanePoint> project_ray(const Lens& lens, const Ray& ray);
// Returns the ray, of any length, that a pixel position sees. Returns nullopt if no ray was found: outside of
// the image circle, or where the polynomial of the lens folds.
std::optional<Ray> pixel_ray(const Lens& lens, double column, double row);

}  // namespace ubs
