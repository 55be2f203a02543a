// SPDX-License-Identifier: Apache-2.0
// Tests how views are divided into training views and test views. By convention, every 8th image is a test
// image. If there are few images, test images are chosen from those that are surrounded by others.
#include "host/dataset/split_views.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>

#include "host/settings/field.hpp"

using namespace ubs;
using Catch::Contains;

namespace {

// Returns a view with this position that looks in a horizontal direction [rad].
View view_at(int number, double x, double y, double z, double direction = 0) {
  View view;
  view.name = fmt::format("p{:02d}", number);
  const double c = std::cos(direction), s = std::sin(direction);
  view.camera.rotation = {c, 0, -s, 0, 1, 0, s, 0, c};
  view.camera.translation = {-(c * x - s * z), -y, -(s * x + c * z)};
  return view;
}

std::vector<View> walk(int count) {
  std::vector<View> views;
  for (int i = 0; i < count; ++i) views.push_back(view_at(i, i, 0, 0));
  return views;
}

std::vector<std::string> test_names(const std::vector<View>& views, int test_every = kAutoInt) {
  LoadReport report;
  const std::vector<Split> splits = split_views(views, test_every, report);
  std::vector<std::string> names;
  REQUIRE(splits[0].name == "train");
  if (splits.size() > 1)
    for (const View& view : splits[1].views) names.push_back(view.name);
  CHECK(splits[0].views.size() + names.size() == views.size());
  return names;
}

using Names = std::vector<std::string>;

}  // namespace

TEST_CASE("few images: the ends of a walk are training images") {
  CHECK(test_names(walk(3)) == Names{"p01"});
  for (const int count : {5, 8, 9, 11, 16, 17, 23}) {
    CAPTURE(count);
    const Names names = test_names(walk(count));
    CHECK(names.size() == static_cast<std::size_t>((count + 7) / 8));
    int before = -1;
    for (const std::string& name : names) {
      const int number = std::stoi(name.substr(1));
      CHECK((number > 0 && number < count - 1));
      CHECK(number - before > 1);  // no two test images are neighbours
      before = number;
    }
  }
  CHECK(test_names(walk(2)).empty());
  CHECK(test_names(walk(1)).empty());
}

TEST_CASE("few images: the choice depends on positions, not on the order of the names or on the origin") {
  std::vector<View> views;
  const std::vector<int> order{5, 0, 7, 10, 2, 9, 1, 4, 8, 3, 6};
  for (int i = 0; i < 11; ++i)
    views.push_back(view_at(i, 1e6 + 0.5 * order[static_cast<std::size_t>(i)], 0, 0));
  for (const std::string& name : test_names(views)) {
    const int place = order[static_cast<std::size_t>(std::stoi(name.substr(1)))];
    CHECK((place > 1 && place < 9));
  }
}

TEST_CASE("few images: test images are inside of a grid, of an arc and of a pan") {
  std::vector<View> grid, arc, pan;
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 5; ++x) grid.push_back(view_at(5 * y + x, x, y, 0));
  for (const std::string& name : test_names(grid)) {
    const int number = std::stoi(name.substr(1));
    CHECK((number % 5 > 0 && number % 5 < 4 && number / 5 > 0 && number / 5 < 3));
  }
  for (int i = 0; i < 10; ++i) {
    const double angle = std::numbers::pi * i / 9;
    arc.push_back(view_at(i, std::cos(angle), 0, std::sin(angle), -angle - std::numbers::pi / 2));
    pan.push_back(view_at(i, 3, 0, 0, 0.2 * i));
  }
  for (const auto& views : {arc, pan})
    for (const std::string& name : test_names(views)) CHECK((name != "p00" && name != "p09"));
}

TEST_CASE("every 8th image is a test image if there are 24 or more, or every n-th if n is given") {
  CHECK(test_names(walk(11), 8) == Names{"p00", "p08"});
  CHECK(test_names(walk(11), 4) == Names{"p00", "p04", "p08"});
  CHECK(test_names(walk(11), 0).empty());
  CHECK(test_names(walk(24)) == Names{"p00", "p08", "p16"});
  const std::vector<Split> splits = split_every(walk(11), kAutoInt);
  REQUIRE(splits.size() == 2);
  CHECK(splits[1].views.at(1).name == "p08");
}

TEST_CASE("few images: a note names the test images, and the views of an image stay together") {
  std::vector<View> views;
  for (int i = 0; i < 5; ++i)
    for (const char* face : {"_front", "_right"}) {
      View& view = views.emplace_back(view_at(i, i, 0, 0, std::string(face) == "_right" ? 1.5 : 0));
      view.part_of = view.name;
      view.name += face;
    }
  LoadReport report;
  const std::vector<Split> splits = split_views(views, kAutoInt, report);
  REQUIRE(splits.size() == 2);
  REQUIRE(splits[1].views.size() == 2);
  CHECK(splits[1].views[0].name == "p02_front");
  CHECK(splits[1].views[1].name == "p02_right");
  REQUIRE(report.notes.size() == 1);
  CHECK_THAT(report.notes[0],
             Contains("fewer than 24 images") && Contains(" p02 ") && Contains("--test-every 8"));
}
