// SPDX-License-Identifier: Apache-2.0
// Facts are the properties of the training data that automatic settings depend on. host/run/facts_of.hpp
// determines them.
#pragma once

#include <array>
#include <cstddef>
#include <string>

#include "host/scene/choose_dim.hpp"

namespace ubs {

// The default values mean that nothing is known about the data.
struct Facts {
  std::size_t views = 0;   // number of training views; 0: unknown
  double pixels = 0;       // median number of pixels of a view; 0: unknown
  DimChoice dim{0, ""};    // the dimensions that differ between the views; 0: unknown
  bool moves = false;      // the views have different times
  bool one_place = false;  // all cameras are at the same position
  double depth = 0;        // depth of the scene (method.md 4.4) in the unit of the data; 0: unknown
  std::size_t points = 0;  // number of initial points, with those that were triangulated from the images
  std::size_t random_points = 100'000;  // number of splats to place at random if there are no points
  std::string start;                    // where they are placed, for the user
  std::string transparent = "?";        // first image with transparent pixels; empty if all are opaque
  std::array<double, 3> mean_colour{};  // of some images, from 0 to 1
  bool plain_background = false;        // the images show an object in front of a plain background
  bool few_images = false;              // there are so few images that a model overfits them
  bool wide_images = false;             // the views are parts of wide images
  bool opaque() const { return transparent.empty(); }
};

}  // namespace ubs
