// SPDX-License-Identifier: Apache-2.0
#include "host/check/gate.hpp"

#include <optional>

#include "host/base/environment.hpp"
#include "host/base/error.hpp"
#include "host/check/conformance.hpp"
#include "host/check/verdicts.hpp"
#include "host/device/registry.hpp"

namespace ubs::check {
namespace {

bool switched_off() { return environment("UBS_CHECK") == "off"; }

// Checks the device and returns the verdict. Opens a separate Device for the check, so that the check does
// not affect the Device of the command.
Verdict check_now(std::size_t index, const Subject& subject) {
  Verdict verdict{form_text(checked_config(subject.config)), subject.parts};
  const std::unique_ptr<Device> device = open_device(index);
  const Findings findings = examine(*device, subject);
  if (const Finding* wrong = failure(findings)) verdict.right = false, verdict.problem = text(*wrong);
  return verdict;
}

// Reads the stored verdict, or checks the device and stores the verdict. Throws Error(faulty) if the device
// computes wrong results.
void prove(const DeviceInfo& info, std::size_t index, const Subject& subject, const Gate& gate) {
  Verdicts verdicts(info, gate.build);
  std::optional<Verdict> verdict = verdicts.find(form_text(checked_config(subject.config)), subject.parts);
  if (!verdict) {
    gate.on_check(info);
    verdict = check_now(index, subject);
    verdicts.keep(*verdict);
  }
  if (!verdict->right)
    fail(ErrorKind::faulty,
         "{} computes wrong results (variant {}; {}). Use another device or driver. 'ubs devices --check' "
         "repeats the check; UBS_CHECK=off uses the device anyway",
         describe(info), verdict->form, verdict->problem);
}

}  // namespace

void verify_device(const DeviceInfo& info, std::size_t index, const Use& use, const Gate& gate) {
  if (switched_off()) return;
  for (const KernelConfig& config : use.configs(info)) prove(info, index, {config, use.parts}, gate);
}

std::size_t choose_verified_device(const std::string& request, const Use& use, const Gate& gate) {
  const std::vector<DeviceInfo> devices = list_devices();
  const std::vector<std::size_t> candidates = device_candidates(devices, request);
  if (switched_off()) return candidates.front();
  std::optional<Error> first;
  std::string passed_over;
  for (const std::size_t index : candidates) {
    try {
      verify_device(devices[index], index, use, gate);
    } catch (const Error& error) {
      // Only errors of these three kinds are caused by the device. A lack of memory may be temporary, and
      // errors of all other kinds are caused by the command.
      if (error.kind() != ErrorKind::faulty && error.kind() != ErrorKind::device &&
          error.kind() != ErrorKind::build)
        throw;
      if (!first) first = error;
      passed_over += (passed_over.empty() ? "" : "; ") + std::string(error.what());
      continue;
    }
    if (first) gate.on_warning(fmt::format("{}; using {}", passed_over, describe(devices[index])));
    return index;
  }
  throw *first;
}

}  // namespace ubs::check
