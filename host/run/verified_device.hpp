// SPDX-License-Identifier: Apache-2.0
// These functions open verified devices. Before a command uses a device for training, rendering or measuring,
// the kernels that the command needs are verified on this device (host/check/gate.hpp).
#pragma once

#include <memory>
#include <string>

#include "host/check/gate.hpp"
#include "host/device/device.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs {

// Returns the kernels that training with these settings needs.
check::Use training_use(const TrainSettings& settings);
// Returns the kernels that rendering the groups of a model needs. If `backward` is set, the kernels for its
// gradients are included.
check::Use drawing_use(const MixedModel& model, const TrainSettings& settings, bool backward = false);

// Returns the kernels that comparing images needs. If `networks` is set, those of LPIPS are included.
check::Use comparing_use(bool networks);
// Verifies a device. Throws Error(faulty) if the device computes wrong results. `index` is the index of the
// device in list_devices().
void verify_device(const DeviceInfo& info, std::size_t index, const check::Use& use);
// Chooses a device (see choose_verified_device in host/check/gate.hpp), verifies it and opens it. Throws the
// same errors as choose_verified_device() and open_device().
std::unique_ptr<Device> open_verified_device(const std::string& request, const check::Use& use);
// Chooses and verifies a device, and returns a request that selects exactly this device. It can be passed on
// to other processes.
std::string verified_request(const std::string& request, const check::Use& use);

}  // namespace ubs
