// SPDX-License-Identifier: Apache-2.0
// Splats of other tools as a model of the form that they were trained with, and back: Gaussians (or Beta
// splats of DBS) with quaternions and spherical harmonics are a variant of the method (docs/variants.md), so
// neither way changes what is drawn.
#pragma once

#include "host/data/imported_splats.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// dim 3, rot_mode quaternion, colour sh0 to sh3 (degree 4 is cut) or sb1 to sb3, kernel and antialias as the
// splats say. Scales go through the inverse of softplus: relative error at most 2e-6, that of float32 raw
// values.
SplatModel exact_model(const ImportedSplats& splats);

// N = 3 with the Gaussian kernel, any rotation and colour.
bool is_gaussian_model(const SplatModel& model);

// The splats of a model of N = 3: what its PLY, SPZ or .splat holds. Plain colours become constant harmonics;
// splats that no renderer could show are dropped and counted in the report.
ImportedSplats to_imported_splats(const SplatModel& model);

// Degree of the harmonics that hold the colours of a model, 0 for plain ones, and the colours of splat i.
int harmonic_degree(const ModelVariant& variant);
void copy_colour(const SplatModel& model, std::size_t i, ImportedSplats& out);

}  // namespace ubs
