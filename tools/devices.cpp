// SPDX-License-Identifier: Apache-2.0
// ubs devices: lists the devices with the numbers and names that --device accepts. It can also check whether
// they compute correct results, and look for problems of this machine.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/check/verdicts.hpp"
#include "host/device/registry.hpp"
#include "host/device/tuning.hpp"
#include "tools/commands.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/program_version.hpp"
#include "tools/common/settings_options.hpp"
#include "tools/device_reports.hpp"

namespace ubs::tools {
namespace {

struct DevicesOptions {
  explicit DevicesOptions(CLI::App& app) : settings(app, form_keys()) {}
  std::vector<std::string> devices;
  std::vector<int> dims{3, 6, 7};
  SettingsOptions settings;
  bool check = false, doctor = false, json = false;
};

const check::Verdict* wrong_one(const std::vector<check::Verdict>& verdicts) {
  const auto found = std::ranges::find(verdicts, false, &check::Verdict::right);
  return found == verdicts.end() ? nullptr : &*found;
}

std::string verdict_text(const std::vector<check::Verdict>& verdicts) {
  if (verdicts.empty()) return "not checked yet by this build (ubs devices --check)";
  if (const check::Verdict* wrong = wrong_one(verdicts))
    return fmt::format("WRONG RESULTS for {}: {}", wrong->form, wrong->problem);
  std::string forms;
  for (const check::Verdict& v : verdicts) forms += (forms.empty() ? "" : "; ") + v.form;
  return "checked, results are correct: " + forms;
}

Json verdict_json(const std::vector<check::Verdict>& verdicts) {
  Json forms = Json::array();
  for (const check::Verdict& v : verdicts)
    forms.push_back({{"form", v.form}, {"right", v.right}, {"problem", v.problem}});
  return {{"verdict", verdicts.empty()      ? "unchecked"
                      : wrong_one(verdicts) ? "failed"
                                            : "ok"},
          {"forms", std::move(forms)}};
}

int list(const DevicesOptions& options) {
  if (options.devices.size() > 1)
    fail(ErrorKind::usage, "--device: several devices are only allowed with --check and --doctor");
  const std::vector<DeviceInfo> devices = list_devices();
  const std::size_t chosen = choose_device(devices, options.devices.empty() ? "" : options.devices[0]);
  if (options.json) {
    Json list = Json::array();
    for (const DeviceInfo& device : devices) {
      list.push_back(device_json(device));
      list.back()["check"] = verdict_json(check::Verdicts(device, build_id()).all());
    }
    print_json({{"devices", std::move(list)}, {"chosen", chosen}});
    return 0;
  }
  for (std::size_t i = 0; i < devices.size(); ++i) {
    const DeviceInfo& d = devices[i];
    say("{} {}  {:<4} {}\n", i == chosen ? '*' : ' ', i, to_string(d.type), describe(d));
    say("          {:.1f} GiB, largest buffer {:.1f} GiB, {} compute units, {} float lanes, {}, {}\n",
        gib(d.memory_bytes), gib(d.max_allocation_bytes), d.compute_units, d.float_vector_width,
        d.has_double ? "double" : "no double", d.version);
    if (const std::size_t same = same_card(devices, i); same != i)
      say("          the same card as {} (PCI {})\n", same, d.pci);
    say("          {}\n", verdict_text(check::Verdicts(d, build_id()).all()));
    if (!d.tuning.empty()) {
      say("          tuned ({}):", tuning_file(d).string());
      for (const auto& [macro, value] : d.tuning) say(" {}={}", macro, value);
      say("\n");
    }
  }
  say("* is the default device (without --device)\n");
  return 0;
}

int run(const DevicesOptions& options) {
  if (options.check) return check_devices(options.devices, options.dims, options.settings, options.json);
  if (options.doctor) return diagnose(options.devices, options.json);
  return list(options);
}

}  // namespace

Command add_devices(CLI::App& root) {
  CLI::App* app =
      root.add_subcommand("devices", "List the compute devices, check their results, and look for problems");
  const auto options = std::make_shared<DevicesOptions>(*app);
  app->add_option("--device", options->devices,
                  "device to mark in the list, or devices to examine with --check and --doctor "
                  "[UBS_DEVICE; otherwise the default device is marked, or all devices are examined]")
      ->delimiter(',')
      ->type_name("A,B");
  CLI::Option* check =
      app->add_flag("--check", options->check,
                    "compare every stage with a float64 reference; exit code 10 if a device computes wrong "
                    "results");
  app->add_option("--dim", options->dims, "with --check: dimensions of the splats [3,6,7]")
      ->delimiter(',')
      ->check(from_to(kMinDim, kMaxDim))
      ->needs(check)
      ->type_name("N,N");
  app->add_flag("--doctor", options->doctor,
                "check this machine's installation and devices, and suggest fixes")
      ->excludes(check);
  app->add_flag("--json", options->json, "machine-readable output");
  options->settings.need(*app, check);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
