// SPDX-License-Identifier: Apache-2.0
// What checks of a device found, kept beside compiled kernels (kernel_cache_folder()): one file a device and
// driver, with the verdicts of the builds that used it last. A file that cannot be read counts as none.
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
  std::string problem;  // of a wrong one: stage and numbers, or why its kernels do not build
};

class Verdicts {
 public:
  // `build` names the executable (its build id). With UBS_KERNEL_DIR the sources there are a part of it.
  Verdicts(const DeviceInfo& device, const std::string& build);

  const std::vector<Verdict>& all() const { return verdicts_; }
  // Of the form, and of these parts at least.
  std::optional<Verdict> find(const std::string& form, const Parts& parts) const;
  // In place of what was known of the form and parts. Where nothing can be written nothing is kept.
  void keep(Verdict verdict);
  void forget();  // all of this device and build

 private:
  void write() const;

  std::string file_, device_, build_;
  std::vector<Verdict> verdicts_;
};

}  // namespace ubs::check
