// SPDX-License-Identifier: Apache-2.0
// Verdicts stores the results of device checks next to the compiled kernels (kernel_cache_folder()). There is
// one file per device and driver, with the verdicts of the builds that used it most recently. A file that
// cannot be read is treated as empty.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/check/subject.hpp"

namespace ubs::check {

struct Verdict {
  std::string form;  // form_text()
  Parts parts;
  bool right = true;
  std::string problem;  // if wrong: stage and numbers, or the reason why the kernels do not build
};

class Verdicts {
 public:
  // `build` identifies the executable (its build id). With UBS_KERNEL_DIR, the kernel sources in that folder
  // become part of this identity.
  Verdicts(const DeviceInfo& device, const std::string& build);

  const std::vector<Verdict>& all() const { return verdicts_; }
  // Returns the verdict for this form that covers at least these parts.
  std::optional<Verdict> find(const std::string& form, const Parts& parts) const;
  // Stores a verdict and replaces older ones for the same form and parts. If the file cannot be written,
  // nothing is stored.
  void keep(Verdict verdict);
  void forget();  // removes all verdicts for this device and build

 private:
  void write() const;

  std::string file_, device_, build_;
  std::vector<Verdict> verdicts_;
};

}  // namespace ubs::check
