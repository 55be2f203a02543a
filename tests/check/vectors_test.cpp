// SPDX-License-Identifier: Apache-2.0
// Tests of the reference data of the device check, and of the table of forms. A form is a combination of a
// variant, N and the setting query_grad for which reference data exist (host/check/forms.hpp). The tests
// check which form is used in place of combinations without reference data, that the data of all forms are
// complete, and that damaged data are rejected.
#include "host/check/vectors.hpp"

#include <algorithm>
#include <catch2/catch.hpp>

#include "host/base/error.hpp"
#include "host/check/forms.hpp"
#include "host/check/subject.hpp"

namespace ubs::check {
namespace {

TEST_CASE("forms: each form of the table is nearest to itself, and the table contains a form for every N") {
  for (std::size_t i = 0; i < forms().size(); ++i) {
    INFO("N = " << forms()[i].dim << ", " << to_string(forms()[i].variant));
    CHECK(nearest_form(forms()[i]) == i);
    CHECK_NOTHROW(check_variant(forms()[i].dim, forms()[i].variant));
  }
  for (int dim = kMinDim; dim <= kMaxDim; ++dim) CHECK(forms()[nearest_form({dim})] == Form{dim});
  CHECK_THROWS_AS(nearest_form({12}), Error);
}

TEST_CASE("forms: a form without reference data is checked in the nearest form with the same N") {
  const auto nearest = [](const Form& form) { return forms()[nearest_form(form)]; };
  const ModelVariant whiten{.cov_mode = CovMode::whiten};
  ModelVariant whiten_sh1 = whiten;
  whiten_sh1.colour = ColourMode::sh1;
  // The form {6, {}, true} is equally near, but follows later in the table.
  CHECK(nearest({6, whiten, true}) == Form{6, whiten});
  // The form {6, sh1} is equally near, but follows later in the table.
  CHECK(nearest({6, whiten_sh1, false}) == Form{6, whiten});
  CHECK(nearest({9, whiten}) == Form{9});  // the only form with N = 9
  CHECK(nearest({3, {}, true}) == Form{3});
  const ModelVariant dbs3{.rot_mode = RotMode::quaternion, .colour = ColourMode::sb3};
  CHECK(nearest({3, dbs3}).variant.rot_mode == RotMode::quaternion);

  KernelConfig config{.dim = 7, .query_grad = true, .variant = whiten, .alpha_min = 0.1f};
  config.backward = false;
  const KernelConfig checked = checked_config(config);
  CHECK(form_of(checked) == Form{7, {}, true});
  CHECK(checked.alpha_min == 0);
  CHECK_FALSE(checked.backward);  // checked_config() keeps the value of the caller, as for the rasteriser
  CHECK(form_text(checked) == "N = 7, vectors, query_grad, forward only");
}

TEST_CASE("vectors: every form has a scene with gradients") {
  const Vectors& v = embedded_vectors();
  REQUIRE(v.forms.size() == forms().size());
  for (std::size_t i = 0; i < v.forms.size(); ++i) {
    const FormVectors& f = v.forms[i];
    INFO("N = " << forms()[i].dim << ", " << to_string(forms()[i].variant));
    CHECK(form_of({.dim = f.problem.model.dim,
                   .query_grad = f.problem.query_grad,
                   .variant = f.problem.model.variant}) == forms()[i]);
    CHECK(f.problem.camera.width == kWidth);
    CHECK(f.problem.camera.height == kHeight);
    CHECK(std::ranges::count(f.truth.visible, 1) > 128);  // more splats than any rasteriser reads at once
    const auto undecided = static_cast<std::size_t>(std::ranges::count(f.problem.undecided, 1));
    CHECK(undecided < f.problem.undecided.size() / 4);
    for (const ParameterGroup& group : parameter_groups(f.problem.model.layout())) {
      INFO(group.name);
      const auto first = f.truth.v_params.begin() + group.first * static_cast<std::ptrdiff_t>(kSplats);
      const auto size = group.count * static_cast<std::ptrdiff_t>(kSplats);
      if (group.count > 0) CHECK(std::any_of(first, first + size, [](double x) { return x != 0; }));
    }
  }
}

TEST_CASE("vectors: unpacking restores the packed reference data, and damaged data are rejected") {
  const Vectors& v = embedded_vectors();
  const std::vector<std::byte> bytes = pack(v);
  const Vectors again = unpack(bytes);
  CHECK(again.forms.back().truth.v_params == v.forms.back().truth.v_params);
  CHECK(again.forms.back().problem.camera == v.forms.back().problem.camera);
  CHECK(again.loss.v_image == v.loss.v_image);
  CHECK(again.adam.scale_penalty == v.adam.scale_penalty);
  CHECK(again.metrics.ssim == v.metrics.ssim);

  for (const std::size_t size : {std::size_t{0}, std::size_t{8}, bytes.size() / 2, bytes.size() - 1})
    CHECK_THROWS_AS(unpack(std::span(bytes).first(size)), Error);
  for (const std::size_t at : {std::size_t{0}, std::size_t{7}, bytes.size() / 3, bytes.size() - 1}) {
    INFO("byte " << at);
    std::vector<std::byte> damaged = bytes;
    damaged[at] ^= std::byte{0x10};
    CHECK_THROWS_AS(unpack(damaged), Error);
  }
  Vectors shorter = v;
  shorter.forms[0].truth.image.pop_back();
  CHECK_THROWS_AS(pack(shorter), Error);
}

}  // namespace
}  // namespace ubs::check
