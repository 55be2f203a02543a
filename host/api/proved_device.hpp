// SPDX-License-Identifier: Apache-2.0
// Opens verified devices. A device that a command uses for training, rendering or measuring must first have
// been verified: it computes correctly what the command needs (host/check/gate.hpp).
#pragma once

#include <memory>
#include <string>

#include "host/check/gate.hpp"
#include "host/device/device.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// Returns what a training with these settings needs.
check::Use training_use(const TrainSettings& settings);
// Returns what rendering a model needs, for each of its groups. `backward`: also its gradients.
check::Use drawing_use(const MixedModel& model, const TrainSettings& settings, bool backward = false);

// Returns what comparing images needs. `networks`: also LPIPS.
check::Use comparing_use(bool networks);
// Throws Error(faulty) if this device, which is number `index` in list_devices(), computes wrong results.
void prove_device(const DeviceInfo& info, std::size_t index, const check::Use& use);
// Throws the same errors as choose_proved_device() and open_device().
std::unique_ptr<Device> open_proved_device(const std::string& request, const check::Use& use);
// Returns a request that selects exactly the verified device, to be passed on to other processes.
std::string proved_request(const std::string& request, const check::Use& use);

}  // namespace ubs
