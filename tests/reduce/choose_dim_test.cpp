// SPDX-License-Identifier: Apache-2.0
// Tests `--dim auto`, which chooses the dimensions that can be learnt from the training views.
#include "host/scene/choose_dim.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "host/base/error.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/train_settings.hpp"

using namespace ubs;
using Catch::Contains;

namespace {

// Returns views whose cameras are on a ring around the origin. Their time is 0.25, and they have no further
// query values.
std::vector<View> ring(int count) {
  std::vector<View> views;
  for (int i = 0; i < count; ++i) {
    views.push_back({std::to_string(i), oracle::ring_camera({.dim = 7}, i), {}, {}});
    views.back().camera.time = 0.25;
    views.back().camera.extra.clear();
  }
  return views;
}

}  // namespace

TEST_CASE("dim auto: dimensions that differ between the views are used", "[reduce]") {
  std::vector<View> views = ring(6);
  CHECK(choose_dim(views).dim == 6);
  CHECK_THAT(choose_dim(views).reason, Contains("all times are equal") && Contains("degrees apart"));

  for (std::size_t i = 0; i < views.size(); ++i) views[i].camera.time = 0.1 * static_cast<double>(i % 3);
  CHECK(choose_dim(views).dim == 7);
  CHECK_THAT(choose_dim(views).reason, Contains("3 different times"));

  for (View& view : views) view.camera.extra = {0.5, 1.0};
  CHECK(choose_dim(views).dim == 7);  // further query values that are constant cannot be learnt
  views[2].camera.extra[1] = 2;
  CHECK(choose_dim(views).dim == 9);
  views[0].camera.extra.pop_back();  // a view without the second value
  CHECK(choose_dim(views).dim == 7);
}

TEST_CASE("dim auto: the direction is not used if all cameras have the same direction", "[reduce]") {
  std::vector<View> views = ring(1);
  CHECK(choose_dim(views).dim == 3);
  CHECK_THAT(choose_dim(views).reason, Contains("a single view"));
  views.assign(4, views[0]);  // a fixed camera
  CHECK(choose_dim(views).dim == 3);
  CHECK_THAT(choose_dim(views).reason, Contains("one direction"));
  for (std::size_t i = 0; i < 4; ++i) views[i].camera.time = static_cast<double>(i);
  CHECK(choose_dim(views).dim == 4);
  for (std::size_t i = 0; i < 4; ++i) views[i].camera.extra = {static_cast<double>(i)};
  CHECK(choose_dim(views).dim == 5);
  for (std::size_t i = 0; i < 4; ++i) views[i].camera.extra = {0.0, static_cast<double>(i)};
  // Time and two further values are only possible together with the direction.
  CHECK(choose_dim(views).dim == 9);
  CHECK_THAT(choose_dim(views).reason, Contains("the direction is included"));

  // Parallel cameras side by side see the scene from different directions if it is near. As its distance is
  // unknown, the direction is used.
  views.assign(3, ring(1)[0]);
  for (std::size_t i = 0; i < 3; ++i) views[i].camera.translation[0] += static_cast<double>(i);
  CHECK(choose_dim(views).dim == 6);
  CHECK_THROWS_WITH(choose_dim(std::vector<View>{}), Contains("the training split has none"));
}

TEST_CASE("dim auto: the setting dim accepts auto and numbers, and other settings reject auto", "[reduce]") {
  TrainSettings settings;
  const auto fields = bind_fields(settings, train_fields());
  set_field(fields, "dim=auto", "--set");
  CHECK(settings.dim == kAutoInt);
  CHECK(to_json(fields)["dim"] == "auto");
  CHECK_NOTHROW(validate(settings));
  set_field(fields, "dim=4", "--set");
  CHECK(to_json(fields)["dim"] == 4);
  CHECK_THROWS_WITH(set_field(fields, "dim=0", "--set"), Contains("auto or integer 3 to 11"));
  CHECK_THROWS_WITH(set_field(fields, "batch=auto", "--set"), Contains("integer"));
}
