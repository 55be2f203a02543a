// SPDX-License-Identifier: Apache-2.0
// Subject describes what a device check covers: the kernels of one method variant, restricted to those that a
// command needs.
#pragma once

#include <string>
#include <vector>

#include "host/check/forms.hpp"
#include "host/device/stages.hpp"

namespace ubs::check {

enum class Part {
  drawing,    // projection, lists, forward rasteriser
  loss,       // loss, PSNR, SSIM
  gradients,  // backward rasteriser, backward projection
  learning,   // end of a training step, penalties, Adam, relocation, growth, noise
  networks    // SSIM over whole windows, LPIPS; the same for all variants
};
using Parts = std::vector<Part>;
std::string to_string(Part part);

inline const Parts kTraining{Part::drawing, Part::loss, Part::gradients, Part::learning};

struct Subject {
  KernelConfig config;
  Parts parts;
};

// Returns the configuration that is checked for that of a command. Skipped work and approximations
// (alpha_min, math, frozen groups) are switched off, because their effect on accuracy is measured separately
// (docs/accuracy.md). Depth is not rendered. N and the switches become those of nearest_form(), because a
// variant without float64 vectors in the build is checked with the nearest one.
KernelConfig checked_config(KernelConfig config);

Form form_of(const KernelConfig& config);

// Returns a text such as "N = 6, vectors", followed by the settings that are not at their default.
std::string form_text(const KernelConfig& config);

}  // namespace ubs::check
