// SPDX-License-Identifier: Apache-2.0
#include "tools/common/lpips_options.hpp"

#include <cstdlib>

#include "host/base/error.hpp"
#include "tools/common/help.hpp"

namespace ubs::tools {

LpipsOptions::LpipsOptions(CLI::App& app) {
  app.add_option("--lpips", networks_,
                 "also measure LPIPS with these networks: alex, squeeze, vgg (comma-separated)")
      ->delimiter(',')
      ->type_name("NAMES");
  app.add_option("--lpips-weights", weights_,
                 "weights of the networks: a safetensors file, or a folder with lpips_NAME.safetensors "
                 "[UBS_LPIPS_WEIGHTS]")
      ->type_name("FILE|DIR")
      ->group(kRareGroup);
  range_option_ =
      app.add_option(
             "--lpips-range", range_,
             "range of the pixel values that the networks get: signed ([-1,1], as LPIPS is defined), unit or "
             "published ([0,1], as in published results of splats), or both [both]")
          ->check(CLI::IsMember({"signed", "unit", "published", "both"}))
          ->type_name("RANGE")
          ->group(kRareGroup);
}

LpipsRequest LpipsOptions::request() const {
  LpipsRequest request{.networks = networks_};
  if (networks_.empty()) {
    if (!weights_.empty())
      fail(ErrorKind::usage,
           "--lpips-weights requires --lpips: choose the networks, for example --lpips alex");
    if (range_option_->count() > 0)
      fail(ErrorKind::usage, "--lpips-range requires --lpips: choose the networks, for example --lpips alex");
    return request;
  }
  for (const std::string& name : networks_) lpips_network(name);
  const char* variable = std::getenv("UBS_LPIPS_WEIGHTS");
  request.weights = !weights_.empty() ? weights_ : variable ? variable : "";
  if (request.weights.empty()) fail(ErrorKind::usage, "--lpips needs --lpips-weights or UBS_LPIPS_WEIGHTS");
  if (range_ == "signed") request.ranges = {LpipsRange::signed_one};
  if (range_ == "unit" || range_ == "published") request.ranges = {LpipsRange::unit};
  return request;
}

}  // namespace ubs::tools
