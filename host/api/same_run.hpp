// SPDX-License-Identifier: Apache-2.0
// Whether a checkpoint can be continued here with the bits that the run would have had without interruption.
#pragma once

#include <string>

#include "host/cluster/communicator.hpp"
#include "host/device/device.hpp"
#include "host/train/checkpoint.hpp"

namespace ubs {

// What results depend on of a device: its name and driver, vector width and tuned constants.
std::string device_text(const DeviceInfo& info);

// What a checkpoint of this run says, but for its state. `data`: path, or a name; `data_print`: fingerprint()
// of the training views as the data give them.
Checkpoint identity(const TrainSettings& settings, std::string data, std::uint32_t data_print,
                    const Device& device);

// Throws Error(data) where results would not be those of the run without interruption; another build is a
// warning.
void check_same_run(const Checkpoint& before, const Checkpoint& now, bool any_device);

// All ranks say what they are about to train: throws Error(usage) on all of them where a rank has another
// build, other data or other settings. `run` gets the devices of all, how many kinds of which is returned;
// several are a warning.
int join_run(Communicator& ranks, Checkpoint& run);

}  // namespace ubs
