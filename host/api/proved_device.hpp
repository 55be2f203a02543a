// SPDX-License-Identifier: Apache-2.0
// The device for a command that trains, draws or measures: one that has shown that it computes what the
// command needs (host/check/gate.hpp).
#pragma once

#include <memory>
#include <string>

#include "host/check/gate.hpp"
#include "host/device/device.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// Of a training with these settings.
check::Use training_use(const TrainSettings& settings);
// Of drawing a model, each of its groups; `backward`: and of its gradients.
check::Use drawing_use(const MixedModel& model, const TrainSettings& settings, bool backward = false);

// Of comparing images; `networks`: with LPIPS.
check::Use comparing_use(bool networks);
// Throws Error(faulty) where this one, in its place of list_devices(), computes wrong results.
void prove_device(const DeviceInfo& info, std::size_t index, const check::Use& use);
// Throws as choose_proved_device() and open_device() do.
std::unique_ptr<Device> open_proved_device(const std::string& request, const check::Use& use);
// A request that names the device and no other, to be passed on.
std::string proved_request(const std::string& request, const check::Use& use);

}  // namespace ubs
