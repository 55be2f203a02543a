// SPDX-License-Identifier: Apache-2.0
// What of a device is checked: the kernels of one form of the method, and of them what a command needs.
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
  learning,   // a training step's end, penalties, Adam, relocation, growth, noise
  networks    // SSIM over whole windows, LPIPS; the same for all forms
};
using Parts = std::vector<Part>;
std::string to_string(Part part);

inline const Parts kTraining{Part::drawing, Part::loss, Part::gradients, Part::learning};

struct Subject {
  KernelConfig config;
  Parts parts;
};

// The kernels that are checked for those of a command. Where work is left out, results are approximate or
// sums have no order (alpha_min, Approximation, frozen groups) it is the exact form: what these
// switches cost has its own measures (docs/accuracy.md). Depth is not drawn. N and the switches become those
// of nearest_form(): a form that the build has no float64 vectors of is checked in the nearest one.
KernelConfig checked_config(KernelConfig config);

Form form_of(const KernelConfig& config);

// "N = 6, vectors" and what is not the default.
std::string form_text(const KernelConfig& config);

}  // namespace ubs::check
