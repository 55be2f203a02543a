// SPDX-License-Identifier: Apache-2.0
// ubs devices: what there is to compute on, with the numbers and names that --device takes.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/check/verdicts.hpp"
#include "host/device/registry.hpp"
#include "host/device/tuning.hpp"
#include "tools/commands.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/output.hpp"
#include "tools/common/version.hpp"

namespace ubs::tools {
namespace {

struct DevicesOptions {
  std::string device;
  bool json = false;
};

const check::Verdict* wrong_one(const std::vector<check::Verdict>& verdicts) {
  const auto found = std::ranges::find(verdicts, false, &check::Verdict::right);
  return found == verdicts.end() ? nullptr : &*found;
}

std::string verdict_text(const std::vector<check::Verdict>& verdicts) {
  if (verdicts.empty()) return "not checked yet by this build (ubs check)";
  if (const check::Verdict* wrong = wrong_one(verdicts))
    return fmt::format("WRONG RESULTS for {}: {}", wrong->form, wrong->problem);
  std::string forms;
  for (const check::Verdict& v : verdicts) forms += (forms.empty() ? "" : "; ") + v.form;
  return "checked, right: " + forms;
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

int run(const DevicesOptions& options) {
  const std::vector<DeviceInfo> devices = list_devices();
  const std::size_t chosen = choose_device(devices, options.device);
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
  say("* is what runs without --device here.\n");
  return 0;
}

}  // namespace

Command add_devices(CLI::App& root) {
  const auto options = std::make_shared<DevicesOptions>();
  CLI::App* app = root.add_subcommand("devices", "List the compute devices");
  app->add_flag("--json", options->json, "machine-readable output");
  add_device_option(*app, options->device);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
