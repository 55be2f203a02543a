// SPDX-License-Identifier: Apache-2.0
// LpipsOptions has the options --lpips, --lpips-weights and --lpips-range of every command that measures
// images.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "host/pipeline/image_metrics.hpp"

namespace ubs::tools {

class LpipsOptions {
 public:
  explicit LpipsOptions(CLI::App& app);
  // Returns the networks, weights and ranges that the options request. Without --lpips, the request contains
  // no networks. Throws Error(usage) for unknown networks or missing weights, and if another of these
  // options is given without --lpips.
  LpipsRequest request() const;
  bool wanted() const { return !networks_.empty(); }

 private:
  std::vector<std::string> networks_;
  std::string weights_, range_ = "both";
  CLI::Option* range_option_;
};

}  // namespace ubs::tools
