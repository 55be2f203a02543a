// SPDX-License-Identifier: Apache-2.0
// ubs check: whether devices compute what the method says; exit code 10 where one does not.
#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/base/stopwatch.hpp"
#include "host/check/conformance.hpp"
#include "host/check/verdicts.hpp"
#include "host/train/run_settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

std::vector<std::string_view> form_keys() {
  std::vector<std::string_view> keys{"query_grad", "raster"};
  for (const VariantSwitch& s : kVariantSwitches) keys.push_back(s.key);
  return keys;
}

struct CheckOptions {
  explicit CheckOptions(CLI::App& app) : settings(app, form_keys()) {}
  std::vector<std::string> devices;
  std::vector<int> dims{3, 6, 7};
  SettingsOptions settings;
  bool json = false;
};

Json finding_json(const check::Finding& f) {
  return {{"stage", f.stage},
          {"quantity", f.quantity},
          {"error", std::isfinite(f.error) ? Json(f.error) : Json()},
          {"bound", f.bound},
          {"right", f.holds()}};
}

void print(const check::Finding& f) {
  say("  {:<32} {:<28} {:>9.2e} of {:>9.2e}  {}\n", f.stage, f.quantity, f.error, f.bound,
      f.holds() ? "right" : "WRONG");
}

// Some forms exist in some dimensions only, and another one than is asked for must not decide about them.
TrainSettings resolve(const CheckOptions& options) {
  TrainSettings base;
  base.dim = options.dims.front();
  return options.settings.resolve(base);
}

class Checker {
 public:
  explicit Checker(const CheckOptions& options) : options_(options), settings_(resolve(options)) {
    const ModelVariant variant = settings_.variant;
    for (const int dim : options.dims) check_variant(dim, variant);
    expected_.resize(options.dims.size());
    parallel_for(expected_.size(), [&](std::size_t i) {
      KernelConfig config = kernel_config(options_.dims[i], variant, settings_, {});
      expected_[i] = check::expect(config);
    });
  }

  // True where all is right.
  bool run(std::size_t index) {
    const Stopwatch watch;
    const std::unique_ptr<Device> device = open_device(index);
    check::Verdicts verdicts(device->info(), build_id());
    verdicts.forget();
    if (!options_.json) say("{}\n", describe(device->info()));
    Json forms = Json::array();
    bool right = true;
    for (std::size_t i = 0; i < options_.dims.size(); ++i) {
      check::Subject subject{kernel_config(options_.dims[i], settings_.variant, settings_, device->info()),
                             check::kTraining};
      if (i == 0) subject.parts.push_back(check::Part::networks);
      const std::string form = check::form_text(check::checked_config(subject.config));
      if (!options_.json) say(" {}\n", form);
      const check::Findings findings = check::examine(*device, subject, expected_[i]);
      const check::Finding* wrong = check::failure(findings);
      right = right && !wrong;
      verdicts.keep({form, subject.parts, !wrong, wrong ? check::text(*wrong) : ""});
      Json list = Json::array();
      for (const check::Finding& f : findings) {
        list.push_back(finding_json(f));
        if (!options_.json) print(f);
      }
      forms.push_back({{"form", form}, {"stages", std::move(list)}});
    }
    const double seconds = watch.seconds();
    if (!options_.json)
      say(" {} ({:.1f} s)\n", right ? "right" : "THIS DEVICE COMPUTES WRONG RESULTS", seconds);
    devices_.push_back({{"device", device_json(device->info())},
                        {"right", right},
                        {"seconds", seconds},
                        {"forms", std::move(forms)}});
    return right;
  }

  Json json() const { return {{"version", version()}, {"build", build_id()}, {"devices", devices_}}; }

 private:
  const CheckOptions& options_;
  TrainSettings settings_;
  std::vector<check::Expected> expected_;
  Json devices_ = Json::array();
};

int run(const CheckOptions& options) {
  Checker checker(options);
  const std::vector<DeviceInfo> devices = list_devices();
  std::vector<std::size_t> chosen;
  if (options.devices.empty()) chosen = device_candidates(devices, "");
  for (const std::string& name : options.devices) chosen.push_back(choose_device(devices, name));
  bool right = true;
  for (const std::size_t index : chosen) right = checker.run(index) && right;
  if (options.json) print_json(checker.json());
  return right ? 0 : exit_code(ErrorKind::faulty);
}

}  // namespace

Command add_check(CLI::App& root) {
  CLI::App* app = root.add_subcommand("check", "Compare every stage of devices with float64");
  const auto options = std::make_shared<CheckOptions>(*app);
  app->add_option("--device", options->devices,
                  "devices, as for --device of other commands [UBS_DEVICE, else all]")
      ->delimiter(',')
      ->type_name("A,B");
  app->add_option("--dim", options->dims, "dimensions of the splats [3,6,7]")
      ->delimiter(',')
      ->check(from_to(kMinDim, kMaxDim))
      ->type_name("N,N");
  app->add_flag("--json", options->json, "machine-readable output");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
