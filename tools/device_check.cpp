// SPDX-License-Identifier: Apache-2.0
// ubs devices --check: checks whether devices compute correct results.
#include <cmath>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/check/conformance.hpp"
#include "host/check/verdicts.hpp"
#include "host/train/run_settings.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/output.hpp"
#include "tools/common/program_version.hpp"
#include "tools/device_reports.hpp"

namespace ubs::tools {
namespace {

Json finding_json(const check::Finding& f) {
  return {{"stage", f.stage},
          {"quantity", f.quantity},
          {"error", std::isfinite(f.error) ? Json(f.error) : Json()},
          {"bound", f.bound},
          {"right", f.holds()}};
}

void print(const check::Finding& f) {
  say("  {:<32} {:<28} {:>9.2e} of {:>9.2e}  {}\n", f.stage, f.quantity, f.error, f.bound,
      f.holds() ? "correct" : "WRONG");
}

// Resolves the settings for one of the requested dimensions, because some variants only exist in some
// dimensions, and the default dimension may not be one of them.
TrainSettings resolve(const std::vector<int>& dims, const SettingsOptions& settings) {
  TrainSettings base;
  base.dim = dims.front();
  return settings.resolve(base);
}

class Checker {
 public:
  Checker(const std::vector<int>& dims, const SettingsOptions& settings, bool json)
      : dims_(dims), settings_(resolve(dims, settings)), json_(json) {
    for (const int dim : dims) check_variant(dim, settings_.variant);
  }

  // Checks the device with this index, and stores and prints the results. Returns whether all are correct.
  bool run(std::size_t index) {
    const Stopwatch watch;
    const std::unique_ptr<Device> device = open_device(index);
    check::Verdicts verdicts(device->info(), build_id());
    verdicts.forget();
    if (!json_) say("{}\n", describe(device->info()));
    Json forms = Json::array();
    bool right = true;
    for (std::size_t i = 0; i < dims_.size(); ++i) {
      check::Subject subject{kernel_config(dims_[i], settings_.variant, settings_, device->info()),
                             check::kTraining};
      if (i == 0) subject.parts.push_back(check::Part::networks);
      const std::string form = check::form_text(check::checked_config(subject.config));
      const std::string asked = check::form_text(subject.config);
      if (!json_)
        say(" {}{}\n", form,
            form == asked
                ? ""
                : fmt::format(" (checked in place of {}, which has no float64 results)", asked));
      const check::Findings findings = check::examine(*device, subject);
      const check::Finding* wrong = check::failure(findings);
      right = right && !wrong;
      verdicts.keep({form, subject.parts, !wrong, wrong ? check::text(*wrong) : ""});
      Json list = Json::array();
      for (const check::Finding& f : findings) {
        list.push_back(finding_json(f));
        if (!json_) print(f);
      }
      forms.push_back({{"form", form}, {"stages", std::move(list)}});
    }
    const double seconds = watch.seconds();
    if (!json_) say(" {} ({:.1f} s)\n", right ? "correct" : "THIS DEVICE COMPUTES WRONG RESULTS", seconds);
    devices_.push_back({{"device", device_json(device->info())},
                        {"right", right},
                        {"seconds", seconds},
                        {"forms", std::move(forms)}});
    return right;
  }

  Json json() const { return {{"version", version()}, {"build", build_id()}, {"devices", devices_}}; }

 private:
  const std::vector<int>& dims_;
  TrainSettings settings_;
  bool json_;
  Json devices_ = Json::array();
};

}  // namespace

std::vector<std::string_view> form_keys() {
  std::vector<std::string_view> keys{"query_grad", "raster"};
  for (const VariantSwitch& s : kVariantSwitches) keys.push_back(s.key);
  return keys;
}

int check_devices(const std::vector<std::string>& names, const std::vector<int>& dims,
                  const SettingsOptions& settings, bool json) {
  Checker checker(dims, settings, json);
  const std::vector<DeviceInfo> devices = list_devices();
  std::vector<std::size_t> chosen;
  if (names.empty()) chosen = device_candidates(devices, "");
  for (const std::string& name : names) chosen.push_back(choose_device(devices, name));
  bool right = true;
  for (const std::size_t index : chosen) right = checker.run(index) && right;
  if (json) print_json(checker.json());
  return right ? 0 : exit_code(ErrorKind::faulty);
}

}  // namespace ubs::tools
