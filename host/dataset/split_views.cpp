// SPDX-License-Identifier: Apache-2.0
// See split_views.hpp.
#include "host/dataset/split_views.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include "host/scene/extent.hpp"
#include "host/settings/field.hpp"

namespace ubs {
namespace {

constexpr std::size_t kFewImages = 24;

const std::string& image_name(const View& view) { return view.part_of.empty() ? view.name : view.part_of; }

void sort_by_name(std::vector<View>& views) {
  std::ranges::stable_sort(views, {}, [](const View& view) {
    return std::pair<const std::string&, const std::string&>(image_name(view), view.name);
  });
}

// Returns the split "train" and, if there are test images, the split "test". `images[i]` contains the indices
// of the views of image i, and `held[i]` says whether image i is a test image.
std::vector<Split> divided(std::vector<View> views, const std::vector<std::vector<std::uint32_t>>& images,
                           const std::vector<char>& held) {
  Split train{"train", {}}, test{"test", {}};
  for (std::size_t i = 0; i < images.size(); ++i)
    for (const std::uint32_t v : images[i]) (held[i] ? test : train).views.push_back(std::move(views[v]));
  std::vector<Split> splits;
  splits.push_back(std::move(train));
  if (!test.views.empty()) splits.push_back(std::move(test));
  return splits;
}

// PlaceAndDirection holds the position of the camera of an image relative to the mean position of all
// cameras, in units of their mean distance from it, and then the mean viewing direction of the views of the
// image.
using PlaceAndDirection = std::array<double, 6>;

std::vector<PlaceAndDirection> places_of(const std::vector<View>& views,
                                         const std::vector<std::vector<std::uint32_t>>& images) {
  std::vector<PlaceAndDirection> places(images.size());
  std::vector<Camera> cameras;
  std::array<double, 3> mean{};
  const auto count = static_cast<double>(images.size());
  for (std::size_t i = 0; i < images.size(); ++i) {
    cameras.push_back(views[images[i][0]].camera);  // all views of an image have the same position
    const auto centre = cameras[i].centre();
    for (std::size_t k = 0; k < 3; ++k) {
      places[i][k] = centre[k];
      mean[k] += centre[k] / count;
      for (const std::uint32_t v : images[i])  // for a panorama, the mean of the directions is 0
        places[i][3 + k] += views[v].camera.rotation[6 + k] / static_cast<double>(images[i].size());
    }
  }
  double spread = 0;
  for (PlaceAndDirection& place : places) {
    for (std::size_t k = 0; k < 3; ++k) place[k] -= mean[k];
    spread += std::hypot(place[0], place[1], place[2]) / count;
  }
  const double scale = at_one_place(cameras) ? 0 : 1 / spread;
  for (PlaceAndDirection& place : places)
    for (std::size_t k = 0; k < 3; ++k) place[k] *= scale;
  return places;
}

double squared_distance(const PlaceAndDirection& a, const PlaceAndDirection& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sum;
}

// Returns a measure from 0 to 1 of how much the training images are on one side of an image. It is 0 if they
// surround the image evenly, and 1 if all of them are in the same direction. It is the length of the weighted
// mean of the unit vectors from the image to the training images; the weights are 1 / squared distance.
double one_sided(const std::vector<PlaceAndDirection>& places, const std::vector<char>& held,
                 std::size_t image) {
  PlaceAndDirection sum{};
  double weights = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double squared = squared_distance(places[i], places[image]);
    if (held[i] || squared == 0) continue;
    const double weight = 1 / squared;
    weights += weight;
    for (std::size_t k = 0; k < sum.size(); ++k)
      sum[k] += weight * (places[i][k] - places[image][k]) / std::sqrt(squared);
  }
  return weights > 0 ? std::sqrt(squared_distance(sum, {})) / weights : 1;
}

// Returns, for each image, the index of the nearest other image.
std::vector<std::size_t> nearest_of(const std::vector<PlaceAndDirection>& places) {
  std::vector<std::size_t> nearest(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    nearest[i] = i == 0 ? 1 : 0;
    for (std::size_t j = 0; j < places.size(); ++j)
      if (j != i && squared_distance(places[i], places[j]) < squared_distance(places[i], places[nearest[i]]))
        nearest[i] = j;
  }
  return nearest;
}

// Chooses `count` test images. Sets of test images that contain an image together with the image nearest to
// it are not considered. Of all other sets, the one with the smallest sum of one_sided() is chosen. If
// several sets are equally good, the set that comes first by name is chosen.
std::vector<char> inner_images(const std::vector<PlaceAndDirection>& places, std::size_t count) {
  constexpr double kEqual = 1e-9;  // sums that differ by less are treated as equal, because of rounding
  const std::vector<std::size_t> nearest = nearest_of(places);
  std::vector<char> held(places.size(), 0), best;
  std::fill_n(held.begin(), count, 1);
  double least = 0;
  do {
    double sum = 0;
    bool apart = true;
    for (std::size_t i = 0; i < places.size() && apart; ++i) {
      if (!held[i]) continue;
      apart = !held[nearest[i]];
      sum += one_sided(places, held, i);
    }
    if (apart && (best.empty() || sum < least - kEqual)) best = held, least = sum;
  } while (std::ranges::prev_permutation(held).found);
  return best;
}

}  // namespace

std::vector<Split> split_every(std::vector<View> views, int test_every) {
  if (test_every == kAutoInt) test_every = kTestEvery;
  sort_by_name(views);
  const auto images = views_by_image(views);
  std::vector<char> held(images.size(), 0);
  for (std::size_t i = 0; test_every > 0 && i < images.size(); i += static_cast<std::size_t>(test_every))
    held[i] = 1;
  return divided(std::move(views), images, held);
}

std::vector<Split> split_views(std::vector<View> views, int test_every, LoadReport& report) {
  sort_by_name(views);
  const auto images = views_by_image(views);
  if (test_every != kAutoInt || images.size() >= kFewImages) return split_every(std::move(views), test_every);
  if (images.size() < 3) return split_every(std::move(views), 0);  // no image is between others
  const std::vector<char> held =
      inner_images(places_of(views, images), (images.size() + kTestEvery - 1) / kTestEvery);
  std::vector<std::string> names;
  for (std::size_t i = 0; i < images.size(); ++i)
    if (held[i]) names.push_back(image_name(views[images[i][0]]));
  report.note(
      fmt::format("fewer than {} images: the test images {} were chosen because their cameras are between "
                  "training cameras; --test-every {} chooses every {}th image by name instead",
                  kFewImages, fmt::join(names, ", "), kTestEvery, kTestEvery));
  return divided(std::move(views), images, held);
}

}  // namespace ubs
