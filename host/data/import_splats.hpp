// SPDX-License-Identifier: Apache-2.0
// Gaussians and DBS splats as splats of ours (method.md 5.4). Three things are lost or changed and
// measured here: harmonics above the constant one, covariances that no I + A represents, and the shape of
// the kernel, (1 - r)^4 in place of exp(-r / 2).
#pragma once

#include "host/data/imported_splats.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// What a file of another tool becomes: exact, the form that it was trained with, quaternions, Gaussian kernel
// and harmonics (gaussian_model.hpp), or beta, the published form (import_splats).
enum class ImportForm { exact, beta };

struct ImportOptions {
  ImportForm form = ImportForm::exact;  // looked at by load_splat_model; the others only with beta
  int dim = 3;            // further dimensions are given no influence: correlation 0, raw beta -8
  double support = 3.08;  // support radius / sigma: 3.0 as the paper, 3.08 for the best images
};

struct ImportedModel {
  SplatModel model;
  double support = 1;       // used: options.support, or 1 for DBS (same kernel)
  std::size_t inexact = 0;  // splats whose covariance is represented with an error above 1e-3
  double median_error = 0, worst_error = 0;  // of those: SkewFactors::error
  bool harmonics_lost = false;

  // Blur that equals the 0.3 px^2 that Gaussian rasterisers add to the variance.
  double matching_eps2d() const { return 0.3 * support * support; }
};

ImportedModel import_splats(const ImportedSplats& splats, const ImportOptions& options = {});

}  // namespace ubs
