// SPDX-License-Identifier: Apache-2.0
// exact_model() converts third-party splats to a model of the variant that they were trained with, and
// to_imported_splats() converts such a model back. Gaussians with quaternions and spherical harmonics,
// and the Beta splats of DBS, are variants of the method (docs/variants.md). So the conversions change the
// rendered image only by rounding, unless the spherical harmonics have degree 4.
#pragma once

#include "host/formats/imported_splats.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

// Makes a model with N = 3 and rot_mode quaternion. The colour mode is sh0 to sh3 or sb1 to sb3; spherical
// harmonics of degree 4 are dropped. Kernel and antialias are those of the splats. Scales are converted with
// the inverse of softplus. Their relative error is at most 2e-6, because the raw values are stored as
// float32.
SplatModel exact_model(const ImportedSplats& splats);

// Returns whether the model has N = 3 and the Gaussian kernel. The modes of rotation and colour do not
// matter.
bool is_gaussian_model(const SplatModel& model);

// Returns the splats of a model with N = 3 in the parameters that PLY, SPZ and .splat files store. Plain
// colours become spherical harmonics of degree 0. Splats that cannot be rendered, for example because a value
// is not finite, are dropped and counted in the report.
ImportedSplats to_imported_splats(const SplatModel& model);

// harmonic_degree() returns the degree of the spherical harmonics that describe the colours of a model; it is
// 0 for plain colours and for spherical Beta lobes. copy_colour() copies the colours of splat i.
int harmonic_degree(const ModelVariant& variant);
void copy_colour(const SplatModel& model, std::size_t i, ImportedSplats& out);

}  // namespace ubs
