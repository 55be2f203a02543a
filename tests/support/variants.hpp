// SPDX-License-Identifier: Apache-2.0
// named_variants() returns the variants of the method with which tests render and train: variants for every
// value of every setting, for combinations whose formulas interact, and for the models of other methods
// (3DGS, 6DGS, 7DGS, DBS).
#pragma once

#include <string>
#include <vector>

#include "host/scene/model_variant.hpp"

namespace ubs::test {

struct NamedVariant {
  std::string name;
  int dim;
  ModelVariant variant;
  bool query_grad = false;
};

inline std::vector<NamedVariant> named_variants() {
  const ModelVariant gs3{
      .rot_mode = RotMode::quaternion, .kernel = SpatialKernel::gaussian, .colour = ColourMode::sh3};
  const ModelVariant gs6{.cov_param = CovParam::cholesky,
                         .beta_cond = BetaCond::off,
                         .beta_opacity = BetaOpacity::gaussian,
                         .kernel = SpatialKernel::gaussian,
                         .colour = ColourMode::sh3};
  const ModelVariant direct_gaussian{.beta_opacity = BetaOpacity::gaussian,
                                     .kernel = SpatialKernel::gaussian,
                                     .conditioning = Conditioning::direct};
  ModelVariant direct_6dgs = gs6;  // a model of 6DGS is converted to this variant
  direct_6dgs.conditioning = Conditioning::direct;
  return {{"taylor2", 3, {.rot_mode = RotMode::taylor2}},
          {"cayley", 3, {.rot_mode = RotMode::cayley}},
          {"exp", 6, {.rot_mode = RotMode::exp}},
          {"quaternion", 3, {.rot_mode = RotMode::quaternion}},
          {"cholesky", 3, {.cov_param = CovParam::cholesky}},
          {"cholesky", 6, {.cov_param = CovParam::cholesky}},
          {"skew_nd", 6, {.cov_param = CovParam::skew_nd}},
          {"skew_nd", 7, {.cov_param = CovParam::skew_nd}},
          {"beta_cond off", 7, {.beta_cond = BetaCond::off}},
          {"beta_opacity none", 6, {.beta_opacity = BetaOpacity::none}},
          {"beta_opacity gaussian", 7, {.beta_opacity = BetaOpacity::gaussian}},
          {"no query betas", 6, {.beta_cond = BetaCond::off, .beta_opacity = BetaOpacity::none}},
          {"whiten", 7, {.cov_mode = CovMode::whiten}},
          {"kernel gaussian", 6, {.kernel = SpatialKernel::gaussian}},
          {"sh0", 6, {.colour = ColourMode::sh0}},
          {"sh1", 6, {.colour = ColourMode::sh1}, true},
          {"sh2", 3, {.colour = ColourMode::sh2}},
          {"sh3", 3, {.colour = ColourMode::sh3}, true},
          {"DBS", 3, {.rot_mode = RotMode::quaternion, .colour = ColourMode::sb2}, true},
          {"sb1", 6, {.colour = ColourMode::sb1}, true},
          {"sb3", 3, {.colour = ColourMode::sb3}},
          {"antialias", 6, {.antialias = Antialias::on}},
          {"skew_nd whiten sh2 antialias",
           7,
           {.cov_param = CovParam::skew_nd,
            .cov_mode = CovMode::whiten,
            .colour = ColourMode::sh2,
            .antialias = Antialias::on},
           true},
          {"direct", 6, {.conditioning = Conditioning::direct}, true},
          {"direct", 7, {.conditioning = Conditioning::direct}},
          {"direct gaussian", 7, direct_gaussian},
          {"direct 6DGS", 6, direct_6dgs},
          {"3DGS", 3, gs3, true},
          {"6DGS", 6, gs6},
          {"7DGS", 7, gs6}};
}

}  // namespace ubs::test
