// SPDX-License-Identifier: Apache-2.0
// lens_models() returns the table of the camera models of COLMAP and nerfstudio, with their numbers, names,
// parameters and projections. undistort.hpp uses the projections and their inverses to convert a distorted
// image to the images of one or several ideal pinhole cameras, because the rasteriser supports only pinhole
// cameras.
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
  // Returns the position of a ray, or nullopt if the formula is not defined for this ray.
  std::optional<PlanePoint> (*project)(const LensCoefficients& k, const Ray& ray);
  // Returns the ray of a position, or nullopt if the lens maps no ray to it.
  std::optional<Ray> (*unproject)(const LensCoefficients& k, const PlanePoint& position);
  // The lens is an ideal pinhole camera if the first `zero_for_pinhole` coefficients are 0. The value -1
  // means that the lens is never an ideal pinhole camera.
  int zero_for_pinhole;
  bool all_directions = false;  // the image shows all directions, and its left and right borders meet
};

// LensModel is a row of the table of camera models. Names in a list are separated by blanks.
struct LensModel {
  int number;                     // number in COLMAP's binary files; -1 for a model that COLMAP does not have
  std::string_view name;          // name in COLMAP's files; in transforms.json, case is ignored
  std::string_view json_aliases;  // further names of the model in transforms.json
  // Names of the parameters in COLMAP's order: focal length (f for both axes, or fx and fy), principal point
  // cx and cy (or the image size w and h), and coefficients of the formula.
  std::string_view parameters;
  std::string_view json_extra;  // further coefficients that transforms.json may contain for this model
  const LensFormula* formula;
};

struct Lens {
  const LensFormula* formula = nullptr;   // nullptr for an ideal pinhole camera
  double fx = 1, fy = 1, cx = 0, cy = 0;  // [px]; the centre of pixel (0,0) is (0.5, 0.5)
  int width = 0, height = 0;
  LensCoefficients k{};  // values of LensFormula::coefficients; the remaining elements are 0

  bool operator==(const Lens&) const = default;
  // Returns false if the lens is an ideal pinhole camera.
  bool distorted() const;
  // Returns the lens for an image that was resized to the given size.
  Lens scaled_to(int new_width, int new_height) const;
  // Sets a parameter by its name in the table. Returns false if the lens has no parameter of this name.
  bool set(std::string_view parameter, double value);
};

// Returns the table, which contains the camera models 0 to 17 of COLMAP 4, and those of other programs.
std::span<const LensModel> lens_models();
// Returns "number NAME, number NAME, ..." of COLMAP's camera models, for messages.
std::string known_lens_models();
// Splits names that are separated by blanks.
std::vector<std::string_view> words_of(std::string_view names);

// Throws Error(data) if a focal length is not positive, or if the coefficients are outside of the domain of
// the formula. The message starts with `where`.
void check_lens(const Lens& lens, const std::string& where);

// Returns the position of `ray` in the image [px], or nullopt if the lens does not see this ray.
std::optional<PlanePoint> project_ray(const Lens& lens, const Ray& ray);
// Returns the ray through a position in the image [px]; its length is arbitrary. Returns nullopt if no ray
// was found, because the position is outside of the image circle, or because the formula of the lens is not
// one-to-one there.
std::optional<Ray> pixel_ray(const Lens& lens, double column, double row);

}  // namespace ubs
