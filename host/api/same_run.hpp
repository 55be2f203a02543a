// SPDX-License-Identifier: Apache-2.0
// Checks whether a checkpoint can be resumed here so that the result is bit-identical to that of an
// uninterrupted run.
#pragma once

#include <string>

#include "host/cluster/communicator.hpp"
#include "host/device/device.hpp"
#include "host/train/checkpoint.hpp"

namespace ubs {

// Returns the properties of a device that results depend on: name and driver, vector width and tuned
// constants.
std::string device_text(const DeviceInfo& info);

// Returns a checkpoint of this run without its state. `data`: path, or a name; `data_print`: fingerprint() of
// the training views as given by the data.
Checkpoint identity(const TrainSettings& settings, std::string data, std::uint32_t data_print,
                    const Device& device);

// Throws Error(data) if the results would differ from those of an uninterrupted run. Only warns if the build
// differs.
void check_same_run(const Checkpoint& before, const Checkpoint& now, bool any_device);

// Compares what all ranks are about to train. Throws Error(usage) on all ranks if a rank has another build,
// other data or other settings. Stores the devices of all ranks in `run` and returns the number of different
// devices; warns if there are several.
int join_run(Communicator& ranks, Checkpoint& run);

}  // namespace ubs
