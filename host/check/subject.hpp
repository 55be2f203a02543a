// SPDX-License-Identifier: Apache-2.0
// Subject describes what a device check covers: the kernels of one method variant, restricted to those that a
// command needs.
#pragma once

#include <string>
#include <vector>

#include "host/check/forms.hpp"
#include "host/device/stages.hpp"

namespace ubs::check {

// A Part is a group of kernels that some commands need and others do not.
enum class Part {
  drawing,    // projection, lists, forward rasteriser
  loss,       // loss, PSNR, SSIM
  gradients,  // backward rasteriser, backward projection
  learning,   // penalties, Adam, the training step in one pass, relocation, growth, noise
  networks    // LPIPS, and SSIM over windows that are inside the image; the same for all variants
};
using Parts = std::vector<Part>;
std::string to_string(Part part);

inline const Parts kTraining{Part::drawing, Part::loss, Part::gradients, Part::learning};

struct Subject {
  KernelConfig config;
  Parts parts;
};

// Returns the configuration that is checked if a command uses `config`. alpha_min, math and frozen have their
// default values, which skip no work and do not approximate, because docs/accuracy.md states the effect of
// other values on the accuracy. Depth is not rendered. The variant and query_grad are those of
// nearest_form(), because only the forms() have float64 results in the build.
KernelConfig checked_config(KernelConfig config);

Form form_of(const KernelConfig& config);

// Returns a string that identifies a configuration, for example "N = 6, vectors". It also lists the settings
// that do not have their default values.
std::string form_text(const KernelConfig& config);

}  // namespace ubs::check
