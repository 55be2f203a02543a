// SPDX-License-Identifier: Apache-2.0
// exact_model() converts splats of other tools to a model of the variant that they were trained with, and
// to_imported_splats() converts back. Gaussians, or Beta splats of DBS, with quaternions and spherical
// harmonics are a variant of the method (docs/variants.md), so neither conversion changes the rendered image.
#pragma once

#include "host/data/imported_splats.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// Makes a model with dim 3 and rot_mode quaternion. The colour mode is sh0 to sh3 (degree 4 is truncated) or
// sb1 to sb3; kernel and antialias are those of the splats. Scales are converted with the inverse of
// softplus. Their relative error is at most 2e-6, which is that of float32 raw values.
SplatModel exact_model(const ImportedSplats& splats);

// Returns whether the model has N = 3 and the Gaussian kernel; rotation and colour may be of any mode.
bool is_gaussian_model(const SplatModel& model);

// Returns the splats of a model of N = 3 with the values that PLY, SPZ and .splat files store. Plain colours
// become constant harmonics. Splats that no renderer could show are dropped and counted in the report.
ImportedSplats to_imported_splats(const SplatModel& model);

// harmonic_degree() returns the degree of the harmonics that hold the colours of a model, 0 for plain
// colours. copy_colour() copies the colours of splat i.
int harmonic_degree(const ModelVariant& variant);
void copy_colour(const SplatModel& model, std::size_t i, ImportedSplats& out);

}  // namespace ubs
