// SPDX-License-Identifier: Apache-2.0
// Verdicts stores the results of device checks in the folder of the compiled kernels (kernel_cache_folder()).
// Each combination of device and driver has a file with the verdicts of a limited number of builds. The
// builds that stored a verdict most recently are kept. A file that cannot be read is treated as empty.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/check/subject.hpp"

namespace ubs::check {

struct Verdict {
  std::string form;  // text that form_text() returns for the checked configuration
  Parts parts;
  bool right = true;
  std::string problem;  // if `right` is false, the stage and the error
};

class Verdicts {
 public:
  // `build` is the build ID of the executable. If UBS_KERNEL_DIR is set, verdicts are stored separately for
  // each version of the kernel sources in that folder.
  Verdicts(const DeviceInfo& device, const std::string& build);

  const std::vector<Verdict>& all() const { return verdicts_; }
  // Returns a stored verdict for this form that covers at least these parts, if there is one.
  std::optional<Verdict> find(const std::string& form, const Parts& parts) const;
  // Stores a verdict. Removes older verdicts for the same form if the new verdict covers all of their parts.
  // If the file cannot be written, the error is ignored.
  void keep(Verdict verdict);
  void forget();  // removes all verdicts for this device and build

 private:
  void write() const;

  std::string file_, device_, build_;
  std::vector<Verdict> verdicts_;
};

}  // namespace ubs::check
